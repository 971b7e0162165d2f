classdef CosimBlock < matlab.System
  % A running co-simulation as a block of Simulink (MATLAB System block, MATLAB only):
  %
  %   uuvsim serve open.ssd --paused      then System object name: uuvsim.CosimBlock
  %
  % A lockstep client of `uuvsim serve`: each sample of the block is one step of that length.
  % Input u: the signals of `Inputs` one after another; output y: those of `Outputs`. y does not
  % depend on u in the same sample, so a loop through a controller is no algebraic loop. The run
  % starts anew with each simulation. The block is interpreted only, as it opens a connection. Texts
  % may have quotes or not, as the dialog of your release requires.
  properties (Nontunable)
    Inputs = 'allocation.tau_d'    % Inputs: names, separated by commas
    Outputs = 'hull.eta, hull.nu'  % Outputs: names, separated by commas
    Start = {}                     % Set at the start: a cell of names and values
    SampleTime = 0.01              % Seconds, a whole multiple of the communication step
    Host = '127.0.0.1'
    Port = 7448
    Lag = 60                       % Seconds that others in lockstep wait for this block
    User = ''                      % Where asked for; the password: environment UUVSIM_PASSWORD
  end
  properties (Access = private)
    Session
    Latest
  end

  methods (Access = protected)
    function setupImpl(self)
      self.Session = self.connected('lockstep', true, 'lag', self.Lag, 'name', 'simulink');
    end

    function resetImpl(self)
      self.Session.reset();
      if ~isempty(self.Start)
        self.Session.set(self.Start);
      end
      self.Session.layout(self.names(self.Inputs), self.names(self.Outputs));
      values = self.Session.get(self.names(self.Outputs));
      self.Latest = self.stacked(values, self.names(self.Outputs));
    end

    function y = outputImpl(self, ~)
      y = self.Latest;
    end

    function updateImpl(self, u)
      self.Latest = self.Session.step(double(u(:)), self.SampleTime);
    end

    function flag = isInputDirectFeedthroughImpl(~, ~)
      flag = false;
    end

    function releaseImpl(self)
      if ~isempty(self.Session)
        self.Session.close();
        self.Session = [];
      end
    end

    function count = getOutputSizeImpl(self)
      s = self.connected();
      leave = onCleanup(@() s.close());
      count = [self.width(s, self.Outputs), 1];
    end

    function type = getOutputDataTypeImpl(~)
      type = 'double';
    end

    function flag = isOutputComplexImpl(~)
      flag = false;
    end

    function flag = isOutputFixedSizeImpl(~)
      flag = true;
    end

    function time = getSampleTimeImpl(self)
      time = createSampleTime(self, 'Type', 'Discrete', 'SampleTime', self.SampleTime);
    end

    function name = getInputNamesImpl(~)
      name = 'u';
    end

    function name = getOutputNamesImpl(~)
      name = 'y';
    end

    function icon = getIconImpl(self)
      icon = sprintf('uuvsim serve\n%s:%d', self.bare(self.Host), self.Port);
    end
  end

  methods (Static, Access = protected)
    function mode = getSimulateUsingImpl()
      mode = 'Interpreted execution';
    end

    function flag = showSimulateUsingImpl()
      flag = false;
    end
  end

  methods (Access = private)
    function s = connected(self, varargin)
      if ~isempty(self.bare(self.User))
        varargin = [varargin, {'user', self.bare(self.User), ...
                               'password', getenv('UUVSIM_PASSWORD')}];
      end
      s = uuvsim.connect('host', self.bare(self.Host), 'port', self.Port, varargin{:});
    end

    function text = bare(~, text)
      text = strtrim(strrep(char(text), '''', ''));
    end

    function list = names(self, text)
      list = strtrim(strsplit(self.bare(text), ','));
      list = list(~cellfun(@isempty, list));
    end

    function count = width(self, s, text)
      list = self.names(text);
      count = 0;
      for k = 1:numel(list)
        count = count + numel(s.get(list{k}));  % an unknown name is refused with near ones
      end
    end

    function y = stacked(~, values, list)
      if numel(list) == 1
        y = double(values(:));
        return
      end
      y = zeros(0, 1);
      for k = 1:numel(list)
        path = matlab.lang.makeValidName(strsplit(list{k}, '.'));
        value = getfield(values, path{:});
        y = [y; double(value(:))];
      end
    end
  end
end
