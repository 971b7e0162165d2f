classdef SimulinkObject < handle
  % What get_param(model, 'Object') gives, and the chart that find gives of it, as a double.
  properties
    Path = '';
    Script = '';
  end
  methods
    function self = SimulinkObject(path)
      self.Path = path;
    end

    function chart = find(self, varargin)
      assert(isequal(varargin(1:3), {'-isa', 'Stateflow.EMChart', 'Path'}));
      chart = SimulinkObject(varargin{4});
    end

    function set.Script(self, text)
      self.Script = text;
      set_param(self.Path, 'Script', text);
    end
  end
end
