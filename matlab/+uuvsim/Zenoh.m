classdef Zenoh < handle
  % A running co-simulation directly over Zenoh:  z = uuvsim.Zenoh();  z.step(10);  z.close();
  %
  % Use it to receive states as a stream beside your calls, or other keys on the same network. For
  % all else use uuvsim.connect(), which needs no compiled code. This class needs uuvsim_zenoh,
  % which matlab/mex/build_zenoh.m compiles, and `uuvsim serve --anyone`, because zenoh-pico cannot
  % authenticate itself. Options, as name and value: 'host', 'port' (7470),
  % 'system' where there are several, 'name', 'lockstep', 'lag' and 'timeout' [s].
  properties (SetAccess = private)
    system = '';        % its name
    name = '';          % of this client
    tick = 0;           % of the present communication point
    time = 0;           % of the present communication point [s]
  end
  properties (Access = private)
    session = [];
    id = '';
    timeout = 10;
    layouts = [];       % what the blocks of each component hold
    watched = [];       % struct array: stream, component
  end

  methods
    function self = Zenoh(varargin)
      options = struct('host', '127.0.0.1', 'port', 7470, 'system', '', 'name', 'matlab', ...
                       'lockstep', false, 'lag', 5, 'timeout', 10);
      options = uuvsim.options_of(options, varargin, 'uuvsim.Zenoh');
      if exist('uuvsim_zenoh') ~= 3
        error('uuvsim:zenoh', ['uuvsim: uuvsim_zenoh is not compiled, or not on the path; see ' ...
              'docs/connections/connect_matlab.md, or use uuvsim.connect(), which needs ' ...
              'nothing compiled.']);
      end
      self.timeout = options.timeout;
      self.session = uuvsim_zenoh('open', sprintf('tcp/%s:%d', options.host, options.port));
      self.system = self.found(options);
      [~, unique] = fileparts(tempname());  % rand would give each new MATLAB the same
      self.id = [sprintf('%x', floor(864e5 * now())), regexprep(unique, '\W', '')];
      uuvsim_zenoh('token', self.session, ['uuvsim/' self.system '/live/client/' self.id]);
      told = self.call('join', {'name', options.name, 'lockstep', logical(options.lockstep), ...
                                'lag', options.lag, 'protocol', 1});
      self.name = told.name;
    end

    function varargout = get(self, varargin)
      % Return the value of a signal; of several signals, one output each.
      names = varargin;
      [~, values] = self.call('get', {'names', listed(names)});
      varargout = values(1:max(1, min(nargout, numel(names))));
    end

    function set(self, varargin)
      % Set unconnected inputs and tunable parameters, all or none: z.set('name', value, ...).
      [held, block] = packed(varargin);
      self.asked('set', ['"values":' held], block);
    end

    function varargout = step(self, n, inputs, outputs)
      % Set inputs {'name', value, ...}, make n communication steps, return outputs {'name', ...}.
      if nargin < 2
        n = 1;
      end
      if nargin < 3
        inputs = {};
      end
      if nargin < 4
        outputs = {};
      end
      [held, block] = packed(inputs);
      fields = sprintf('"n":%.17g,"inputs":%s,"outputs":%s', n, held, ...
                       jsonencode(listed(cellstr(outputs))));
      [~, values] = self.asked('step', fields, block);
      varargout = values(1:min(max(nargout, ~isempty(values)), numel(values)));
    end

    function watch(self, component, keep)
      % Subscribe to the states of a component; the newest `keep` (1000) blocks wait to be read.
      if nargin < 3
        keep = 1000;
      end
      self.layouts = self.call('schema', {});
      if ~isfield(self.layouts.blocks, matlab.lang.makeValidName(component))
        error('uuvsim:InputInvalid', 'uuvsim: no component ''%s''; expected one of %s.', ...
              component, strjoin(fieldnames(self.layouts.blocks).', ', '));
      end
      key = ['uuvsim/' self.system '/state/' component];
      stream = uuvsim_zenoh('watch', self.session, key, keep);
      self.watched = [self.watched, struct('stream', stream, 'component', component)];
    end

    function block = take(self, component)
      % Return the oldest block that waits: tick, time and variables of its component; or [].
      chosen = [];
      if ~isempty(self.watched)
        chosen = find(strcmp({self.watched.component}, component), 1);
      end
      if isempty(chosen)
        error('uuvsim:InputInvalid', ...
              'uuvsim: ''%s'' is not watched; call z.watch(''%s'') first.', component, component);
      end
      bytes = uuvsim_zenoh('take', self.session, self.watched(chosen).stream);
      block = [];
      if ~isempty(bytes)
        block = self.unblocked(component, bytes);
      end
    end

    function [told, values] = call(self, what, fields)
      % Make any call by name and fields {'name', value, ...}; return the answer and its values.
      texts = cell(1, numel(fields) / 2);
      for k = 1:numel(texts)
        texts{k} = [jsonencode(fields{2 * k - 1}) ':' jsonencode(fields{2 * k})];
      end
      [told, values] = self.asked(what, strjoin(texts, ','), uint8([]));
    end

    function close(self)
      % Disconnect; the co-simulation continues without this client.
      if ~isempty(self.session)
        session = self.session;
        if ~isempty(self.name)
          try
            self.call('leave', {});
          catch
          end
        end
        self.session = [];
        uuvsim_zenoh('close', session);
      end
    end

    function delete(self)
      self.close();
    end
  end

  methods (Access = private)
    function [told, values] = asked(self, what, fields, block)
      if isempty(self.session)
        error('uuvsim:closed', ...
              'uuvsim: this connection is closed; z = uuvsim.Zenoh() opens another.');
      end
      if ~isempty(fields)
        fields = [',' fields];
      end
      sent = unicode2native(['{"client":"' self.id '","binary":true' fields '}'], 'UTF-8');
      key = ['uuvsim/' self.system '/call/' what];
      [answer, attached, ok] = uuvsim_zenoh('get', self.session, key, uint8(sent), block, ...
                                            self.timeout);
      told = jsondecode(native2unicode(answer, 'UTF-8'));
      if ~ok
        error(['uuvsim:' told.error], 'uuvsim: %s', told.message);
      end
      if isfield(told, 'moment')
        self.tick = told.moment.tick;
        self.time = told.moment.time;
      end
      values = {};
      if isfield(told, 'values')
        values = struct2cell(told.values);
        for k = 1:numel(values)
          if isstruct(values{k})
            values{k} = unpacked(values{k}, attached);
          end
        end
      end
    end

    function name = found(self, options)
      keys = uuvsim_zenoh('alive', self.session, 'uuvsim/*/live/master', self.timeout);
      parts = cellfun(@(key) strsplit(key, '/'), keys, 'UniformOutput', false);
      there = sort(cellfun(@(part) part{2}, parts, 'UniformOutput', false));
      name = options.system;
      if isempty(name) && numel(there) == 1
        name = there{1};
      elseif isempty(name) || ~any(strcmp(name, there))
        self.close();
        error('uuvsim:InputInvalid', ['uuvsim: %d co-simulations at %s, port %d (%s); name one ' ...
              'of them: ''system''.'], numel(there), options.host, options.port, ...
              strjoin(there, ', '));
      end
    end

    function block = unblocked(self, component, bytes)
      if double(typecast(bytes(17:24), 'int64')) ~= self.layouts.layout
        self.layouts = self.call('schema', {});  % a component was replaced
      end
      numbers = typecast(bytes(25:end), 'double');
      block = struct('tick', double(typecast(bytes(1:8), 'int64')), ...
                     'time', typecast(bytes(9:16), 'double'));
      names = cellstr(self.layouts.blocks.(matlab.lang.makeValidName(component)));
      all_names = {self.layouts.signals.name};
      at = 0;
      for k = 1:numel(names)
        shape = reshape(self.layouts.signals(strcmp(names{k}, all_names)).shape, 1, []);
        count = prod(shape);
        field = matlab.lang.makeValidName(names{k}(numel(component) + 2:end));
        block.(field) = arranged(numbers(at + 1:at + count), shape);
        at = at + count;
      end
    end
  end
end

function list = listed(names)
  list = reshape(names, 1, []);  % a cell, also of one: jsonencode makes an array of it
end

function [held, block] = packed(pairs)
  % Return values as JSON, which holds their places, and their bytes.
  block = uint8([]);
  if mod(numel(pairs), 2) ~= 0
    error('uuvsim:InputInvalid', 'uuvsim: values come in pairs, as in ''hull.v_c'', [0.3 0 0].');
  end
  texts = cell(1, numel(pairs) / 2);
  for k = 1:2:numel(pairs)
    value = pairs{k + 1};
    kind = 'f8';
    if isa(value, 'int64')
      kind = 'i8';
    elseif isa(value, 'uint64')
      kind = 'u8';
    else
      value = uuvsim.numbers_of(pairs{k}, value, []);
    end
    shape = size(value);
    if numel(value) == 1
      shape = [];
    elseif isvector(value)
      shape = numel(value);
    else
      value = permute(value, ndims(value):-1:1);
    end
    texts{(k + 1) / 2} = sprintf('%s:{"at":%d,"type":"%s","shape":[%s]}', jsonencode(pairs{k}), ...
                                 numel(block), kind, commas('%d,', shape));
    block = [block, typecast(reshape(value, 1, []), 'uint8')];
  end
  held = ['{' commas('%s,', texts{:}) '}'];
end

function text = commas(form, varargin)
  text = sprintf(form, varargin{:});
  text = text(1:end - 1);
end

function value = unpacked(held, block)
  classes = struct('f8', 'double', 'i8', 'int64', 'u8', 'uint64');
  shape = reshape(held.shape, 1, []);
  count = prod(shape);
  if strcmp(held.type, '?')
    value = logical(block(held.at + 1:held.at + count));
  else
    exact = typecast(block(held.at + 1:held.at + 8 * count), classes.(held.type));
    value = double(exact);
    if isinteger(exact) && any(abs(value(:)) >= 2^53)
      value = exact;  % doubles are not exact there
    end
  end
  value = arranged(value, shape);
end

function value = arranged(numbers, shape)
  if numel(shape) < 2
    value = reshape(numbers, [], 1);
  else
    value = permute(reshape(numbers, fliplr(shape)), numel(shape):-1:1);
  end
end
