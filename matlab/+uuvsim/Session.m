classdef Session < handle
  % A running co-simulation:  s = uuvsim.connect();  y = s.step([], 0.1);  s.close();
  %
  % Names are "component.variable". Results are structs of arrays: 'hull.eta' is y.hull.eta.
  % Inputs u are such a struct, a containers.Map, a cell {name, value, ...}, or, after
  % s.layout(inputs, outputs), a plain vector (the fastest way; then y is a vector as well).
  properties (SetAccess = private)
    system = '';        % its name
    name = '';          % of this client
    allowed = {};       % read, set, step, manage
    step_size = 0;      % communication step [s]
    tick = 0;           % of the present communication point
    time = 0;           % of the present communication point [s]
  end
  properties (Access = private)
    transport = [];
    known = [];         % the signals, once asked for
    agreed = '';        % inputs and outputs of the layout that the server has for structs
    expected = [];      % the inputs of the layout: name, type, shape
    paths = {};         % where each output of the layout stands in a struct
    shapes = {};
    formats = {};
    vector = {};        % inputs and outputs of the user's layout, or {}
    in_vector = false;  % the server has the user's layout
    inputs = 0;         % numbers in the user's layout
  end

  methods
    function self = Session(options)
      self.transport = uuvsim.Transport(options.host, options.port, options.timeout);
      hello = struct('call', 'hello', 'protocol', 1, 'name', options.name, ...
                     'lockstep', logical(options.lockstep), 'lag', options.lag);
      if ~isempty(options.user)
        hello.user = options.user;
        hello.password = options.password;
      end
      hello.token = options.token;
      if isempty(hello.token)
        hello.token = uuvsim.token(options.host, options.port);
      end
      welcome = self.transport.request(hello, []);
      self.system = welcome.system.system;
      self.name = welcome.client;
      self.allowed = welcome.allowed;
      self.step_size = welcome.step_size;
      self.tick = self.transport.greeting.tick;
      self.time = self.transport.greeting.time;
    end

    function list = signals(self, pattern)
      % All signals (struct array: name, type, shape, unit, causality, settable, description), or
      % those whose name matches `pattern` (a regular expression). Without output: print a table.
      if isempty(self.known)
        answer = self.transport.request(struct('call', 'schema'), []);
        self.known = answer.signals(:);
      end
      list = self.known;
      if nargin > 1
        list = list(~cellfun(@isempty, regexp({list.name}, pattern, 'once')));
      end
      if nargout == 0
        if isempty(list)
          fprintf('no signal has ''%s'' in its name; s.signals lists all %d\n', ...
                  pattern, numel(self.known));
        end
        for k = 1:numel(list)
          shape = sprintf('%d ', list(k).shape);
          fprintf('%-40s %-8s %-6s %-12s %s\n', list(k).name, list(k).type, shape, ...
                  list(k).unit, list(k).causality);
        end
        clear list
      end
    end

    function varargout = get(self, varargin)
      % Return the value of a signal; of several signals, one output each, or a struct of all.
      names = cellstr_of(varargin);
      header = struct('call', 'get', 'names', {names}, 'integers', true);
      [answer, numbers] = self.transport.request(header, []);
      [found, values] = self.columns(answer, numbers);
      if numel(names) == 1 || nargout > 1
        varargout = cell(1, numel(names));
        for k = 1:numel(names)
          varargout{k} = values{strcmp(names{k}, found)};
        end
      else
        varargout{1} = nested(found, values);
      end
    end

    function set(self, varargin)
      % Set unconnected inputs and tunable parameters: s.set('name', value, ...) or s.set(struct).
      header = struct('call', 'set');
      if numel(varargin) == 1
        [names, values] = pairs_of(varargin{1});
      else
        [names, values] = pairs_of(varargin);
      end
      [header, numbers] = self.with_values(header, names, values);
      self.transport.request(header, numbers);
    end

    function previous = layout(self, inputs, outputs)
      % Define the signals in the vectors of s.step(u, dt); the fastest way to step. Without names,
      % steps use structs again. Returns the definition so far, as {in, out}.
      previous = self.vector;
      if nargin < 2
        self.vector = {};
        return
      end
      self.vector = {cellstr_of({inputs}), cellstr_of({outputs})};
      self.inputs = self.agree(self.vector, false);
      self.in_vector = true;
    end

    function y = step(self, u, dt, outputs)
      % Set inputs u, step by dt seconds (default: one communication step), and return outputs:
      % those named, else all. With a vector u: the outputs of the layout, as a vector.
      n = 1;
      if nargin > 2 && ~isempty(dt)
        n = self.steps_of(dt);
      end
      if nargin > 1 && isnumeric(u) && ~isempty(self.vector) && nargin < 4
        if ~self.in_vector
          self.layout(self.vector{1}, self.vector{2});
        end
        if numel(u) ~= self.inputs
          error('uuvsim:InputInvalid', 'uuvsim: u has %d numbers; the layout has %d (%s).', ...
                numel(u), self.inputs, strjoin(self.vector{1}, ', '));
        end
        numbers = self.transport.exchange([n, uuvsim.numbers_of('u', u(:).', [])]);
        self.tick = numbers(1);
        self.time = numbers(2);
        y = numbers(3:end).';
        return
      end
      if nargin < 2
        u = [];
      end
      if nargin < 4
        outputs = self.all_outputs();
      end
      y = self.step_named(u, n, cellstr_of({outputs}));
    end

    function results = run(self, duration, names, patience)
      % Run for a simulated time [s], as fast as possible; return time and signals (by default all
      % outputs), one row for each communication point. `patience`: longest time to wait [s].
      if nargin < 2 || ~isnumeric(duration) || ~isscalar(duration)
        error('uuvsim:InputInvalid', ...
              'uuvsim: run needs a number of seconds, as in r = s.run(20, {''hull.eta''}).');
      end
      if nargin < 3 || isempty(names)
        names = self.all_outputs();
      end
      if nargin < 4
        patience = 3600;
      end
      header = struct('call', 'run', 'duration', duration, 'record', {cellstr_of({names})}, ...
                      'integers', true);
      [answer, numbers] = self.transport.request(header, [], patience);
      self.now(answer);
      [found, values] = self.columns(answer, numbers);
      results = nested(found, values);
    end

    function stream(self, factor)
      % Run in real time, or at a factor of it (default: 1), until s.pause().
      if nargin < 2
        factor = 1;
      end
      self.now(self.transport.request(struct('call', 'run', 'factor', factor), []));
    end

    function pause(self)
      % Stop streaming.
      self.now(self.transport.request(struct('call', 'pause'), []));
    end

    function reset(self, seed, varargin)
      % Go back to the start, with a seed and with start values as in s.set.
      header = struct('call', 'reset');
      if nargin > 1 && ~isempty(seed)
        header.seed = seed;
      end
      numbers = [];
      if numel(varargin) == 1
        [names, values] = pairs_of(varargin{1});
        [header, numbers] = self.with_values(header, names, values);
      elseif numel(varargin) > 1
        [names, values] = pairs_of(varargin);
        [header, numbers] = self.with_values(header, names, values);
      end
      self.now(self.transport.request(header, numbers));
    end

    function id = snapshot(self)
      % Store the whole state; return the name of the snapshot.
      answer = self.transport.request(struct('call', 'snapshot'), []);
      id = answer.snapshot;
    end

    function restore(self, id)
      % Go back to a snapshot.
      if nargin < 2
        error('uuvsim:InputInvalid', ...
              'uuvsim: restore needs what s.snapshot gave, as in s.restore(id).');
      end
      self.now(self.transport.request(struct('call', 'restore', 'snapshot', id), []));
    end

    function discard(self, id)
      % Delete a snapshot; a client can keep 256.
      if nargin < 2
        error('uuvsim:InputInvalid', ...
              'uuvsim: discard needs what s.snapshot gave, as in s.discard(id).');
      end
      self.now(self.transport.request(struct('call', 'discard', 'snapshot', id), []));
    end

    function dismiss(self, client)
      % Remove another client from the lockstep barrier, by its name in s.describe.
      if nargin < 2
        error('uuvsim:InputInvalid', ...
              'uuvsim: dismiss needs the name of a client, as in s.dismiss(''python'').');
      end
      self.now(self.transport.request(struct('call', 'dismiss', 'name', client), []));
    end

    function replace(self, component, source)
      % Replace the source of a component; the run starts again.
      if nargin < 3
        error('uuvsim:InputInvalid', ['uuvsim: replace needs a component and a source, as in ' ...
              's.replace(''controller'', ''my.fmu'').']);
      end
      self.now(self.transport.request(struct('call', 'replace', 'component', component, ...
                                             'source', source), [], 600));
      self.known = [];
      self.agreed = '';
      self.in_vector = false;
    end

    function what = describe(self)
      % Return the server's description of the running system.
      answer = self.transport.request(struct('call', 'describe'), []);
      self.now(answer);
      what = answer.system;
    end

    function close(self)
      % Disconnect; the co-simulation continues without this client.
      if ~isempty(self.transport) && self.transport.isopen()
        try
          self.transport.request(struct('call', 'bye'), []);
        catch
        end
        self.transport.close();
      end
    end

    function delete(self)
      self.close();
    end
  end

  methods (Access = private)
    function names = all_outputs(self)
      list = self.signals();
      chosen = strcmp({list.causality}, 'output') & ~strcmp({list.type}, 'String') ...
               & ~strcmp({list.type}, 'Binary');
      names = {list(chosen).name};
    end

    function count = agree(self, wanted, integers)
      % With `integers`, 64-bit integers are sent unchanged; a vector from the user holds doubles.
      header = struct('call', 'layout', 'inputs', {wanted{1}}, 'outputs', {wanted{2}}, ...
                      'integers', integers);
      answer = self.transport.request(header, []);
      count = total(answer.inputs);
      self.expected = answer.inputs;
      self.shapes = shapes_of(answer.outputs);
      self.formats = {};
      if integers && ~isempty(answer.outputs)
        self.formats = {answer.outputs.format};
      end
      self.paths = cellfun(@path_of, wanted{2}, 'UniformOutput', false);
    end

    function y = step_named(self, u, n, outputs)
      [names, values] = pairs_of(u);
      wanted = [sprintf('%s\n', names{:}), '>', sprintf('%s\n', outputs{:})];
      if self.in_vector || ~strcmp(self.agreed, wanted)
        self.agree({names, outputs}, true);
        self.agreed = wanted;
        self.in_vector = false;
      end
      rows = cell(1, numel(values));
      infos = self.expected;
      for k = 1:numel(values)
        value = row_major(uuvsim.numbers_of(names{k}, values{k}, infos(k)));
        if ~strcmp(infos(k).format, 'float64') && isfloat(value)
          value = integers_of(names{k}, value, infos(k).format);
        end
        rows{k} = bits_of(value);
      end
      numbers = self.transport.exchange([n, rows{:}]);
      self.tick = numbers(1);
      self.time = numbers(2);
      y = struct();
      at = 2;
      all_paths = self.paths;
      all_shapes = self.shapes;
      all_formats = self.formats;
      for k = 1:numel(all_paths)
        count = prod(all_shapes{k});
        path = all_paths{k};
        value = numbers(at + 1:at + count);
        if ~strcmp(all_formats{k}, 'float64')
          value = typecast(value, all_formats{k});
        end
        value = shaped(value, all_shapes{k});
        if numel(path) == 2
          y.(path{1}).(path{2}) = value;
        else
          y = put(y, path, value);
        end
        at = at + count;
      end
    end

    function [header, numbers] = with_values(self, header, names, values)
      % Numbers are sent as columns, each checked against its variable; texts in the header.
      numbers = [];
      columns = {};
      texts = containers.Map();
      for k = 1:numel(names)
        if ischar(values{k}) || isa(values{k}, 'string')
          texts(names{k}) = char(values{k});
        else
          value = uuvsim.numbers_of(names{k}, values{k}, self.info_of(names{k}));
          kind = 'float64';
          if isinteger(value)
            kind = class(value);
          end
          columns{end + 1} = struct('name', names{k}, 'shape', {{numel(value)}}, 'format', kind);
          numbers = [numbers, bits_of(row_major(value))];
        end
      end
      header.columns = columns;
      if texts.Count > 0
        header.values = texts;
      end
    end

    function info = info_of(self, name)
      % Return the description of a signal; [] for an unknown name, which the server refuses.
      list = self.signals();
      info = list(strcmp(name, {list.name}));
    end

    function n = steps_of(self, dt)
      n = round(dt / self.step_size);
      if ~(dt >= 0) || abs(n * self.step_size - dt) > 1e-6 * self.step_size + 1e-9
        error('uuvsim:InputInvalid', ...
              ['uuvsim: dt = %g s was read; expected a whole multiple of the communication ' ...
               'step, %g s.'], dt, self.step_size);
      end
    end

    function now(self, answer)
      self.tick = answer.tick;
      self.time = answer.time;
    end

    function [names, values] = columns(self, answer, numbers)
      names = {};
      values = {};
      at = 0;
      for k = 1:numel(answer.columns)
        column = answer.columns(k);
        shape = reshape(column.shape, 1, []);
        count = prod(shape);
        value = reshape(numbers(at + 1:at + count), 1, []);
        if ~strcmp(column.format, 'float64')
          value = typecast(value, column.format);
        end
        value = shaped(value, shape);
        at = at + count;
        if strcmp(column.type, 'Boolean')
          value = logical(value);
        end
        names{end + 1} = column.name;
        values{end + 1} = value;
      end
      for k = 1:numel(answer.texts)
        names{end + 1} = answer.texts(k).name;
        values{end + 1} = answer.texts(k).value;
      end
    end
  end
end

function names = cellstr_of(given)
  % Return a cell of names from names and cells of names.
  names = {};
  for k = 1:numel(given)
    if iscell(given{k})
      names = [names, reshape(given{k}, 1, [])];
    elseif ischar(given{k})
      names = [names, given(k)];
    elseif isa(given{k}, 'string')
      names = [names, reshape(cellstr(given{k}), 1, [])];
    else
      error('uuvsim:InputInvalid', ...
            'uuvsim: a %s was read where a signal''s name is due, as ''hull.eta''.', ...
            class(given{k}));
    end
  end
end

function [names, values] = pairs_of(given)
  % Return names and values of a struct of arrays, a containers.Map or a cell {name, value, ...}.
  names = {};
  values = {};
  if isempty(given)
    return
  elseif isstruct(given)
    [names, values] = flattened(given, '');
  elseif isa(given, 'containers.Map')
    names = keys(given);
    values = given.values();
  elseif iscell(given) && mod(numel(given), 2) == 0
    names = cellstr_of(reshape(given(1:2:end), 1, []));
    values = reshape(given(2:2:end), 1, []);
  else
    error('uuvsim:InputInvalid', ...
          ['uuvsim: inputs were given as %s; expected a struct (u.hull.tau), a ' ...
           'containers.Map, a cell {''hull.tau'', value}, or a vector after s.layout.'], ...
          class(given));
  end
end

function [names, values] = flattened(given, prefix)
  names = {};
  values = {};
  if numel(given) ~= 1
    error('uuvsim:InputInvalid', 'uuvsim: %s is an array of %d structs; expected one struct.', ...
          strtrim(['u ' prefix]), numel(given));
  end
  fields = fieldnames(given);
  for k = 1:numel(fields)
    value = given.(fields{k});
    if isstruct(value)
      [inner, inner_values] = flattened(value, [prefix fields{k} '.']);
      names = [names, inner];
      values = [values, inner_values];
    else
      names{end + 1} = [prefix fields{k}];
      values{end + 1} = value;
    end
  end
end

function row = row_major(value)
  % Return the numbers of a value in the order of the server: the last index changes fastest.
  if ndims(value) > 2 || ~isvector(value)
    value = permute(value, ndims(value):-1:1);
  end
  row = reshape(value, 1, []);
end

function row = bits_of(row)
  % Return numbers as the doubles that are sent: 64-bit integers keep their bits.
  if isinteger(row)
    row = typecast(row, 'double');
  end
end

function row = integers_of(name, row, kind)
  % Convert doubles to the integers of a layout.
  exact = cast(row, kind);
  if ~isequal(double(exact), row)
    error('uuvsim:InputInvalid', 'uuvsim: %s: %.17g was given; expected whole numbers of %s.', ...
          name, row(find(double(exact) ~= row, 1)), kind);
  end
  row = exact;
end

function value = shaped(numbers, shape)
  % Return an array from numbers whose last index changes fastest; a vector is a column.
  if numel(shape) < 2
    value = reshape(numbers, [], 1);
  else
    value = permute(reshape(numbers, fliplr(shape)), numel(shape):-1:1);
  end
end

function shapes = shapes_of(infos)
  shapes = cell(1, numel(infos));
  for k = 1:numel(infos)
    shapes{k} = reshape(infos(k).shape, 1, []);
  end
end

function count = total(infos)
  count = 0;
  for k = 1:numel(infos)
    count = count + prod(infos(k).shape);
  end
end

function path = path_of(name)
  % Return the fields of a signal in a struct: 'hull.eta' is {'hull', 'eta'}.
  path = matlab.lang.makeValidName(strsplit(name, '.'));
end

function result = nested(names, values)
  result = struct();
  for k = 1:numel(names)
    result = put(result, path_of(names{k}), values{k});
  end
end

function result = put(result, path, value)
  if numel(path) == 1
    result.(path{1}) = value;
  elseif numel(path) == 2
    result.(path{1}).(path{2}) = value;
  else
    inner = struct();
    if isfield(result, path{1}) && isstruct(result.(path{1}))
      inner = result.(path{1});
    end
    result.(path{1}) = put(inner, path(2:end), value);
  end
end
