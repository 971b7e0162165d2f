classdef SystemDouble < handle
  % Stands in for matlab.System where CosimBlock is tested in Octave.
  methods
    function start(self)
      self.setupImpl();
      self.resetImpl();
    end

    function y = output(self)
      y = self.outputImpl([]);
    end

    function update(self, u)
      self.updateImpl(u);
    end

    function finish(self)
      self.releaseImpl();
    end

    function found = sizes(self)
      found = self.getOutputSizeImpl();
    end
  end
end
