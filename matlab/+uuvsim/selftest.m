function passed = selftest(varargin)
  % Test the client against a running co-simulation, and print a report to send in.
  %
  %   uuvsim.selftest                     connects as uuvsim.connect()
  %   uuvsim.selftest('port', 7448, ...)  with options of uuvsim.connect
  %
  % At the end the co-simulation has its former state, if its components can store their state.
  fprintf('uuvsim.selftest\n');
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    fprintf('  GNU Octave %s, %s\n', OCTAVE_VERSION, computer());
  else
    fprintf('  MATLAB %s, %s\n', version(), computer());
  end
  passed = true;
  try
    s = uuvsim.connect(varargin{:});
  catch reason
    fprintf('  FAILED connect: %s\n', reason.message);
    passed = false;
    return
  end
  leave = onCleanup(@() s.close());
  fprintf('  system %s, communication step %g s, t = %g s\n', s.system, s.step_size, s.time);
  checks = {
    'signals are listed',                       @() lists(s)
    'an output is read',                        @() reads(s)
    'an unknown name is refused in words',      @() refuses(s)
    'a step takes the time it says',            @() steps(s)
    'a vector step takes the time it says',     @() steps_compact(s)
    'a run gives a row for each step',          @() runs(s)
    'a restored snapshot repeats bit by bit',   @() repeats(s)
  };
  for k = 1:size(checks, 1)
    try
      checks{k, 2}();
      fprintf('  ok     %s\n', checks{k, 1});
    catch reason
      passed = false;
      fprintf('  FAILED %s: %s\n', checks{k, 1}, reason.message);
    end
  end
  try
    fprintf('  round trip of a vector step: %.3f ms (median of 200)\n', 1e3 * round_trip(s, 200));
  catch reason
    fprintf('  round trip not measured: %s\n', reason.message);
  end
end

function names = some_outputs(s)
  list = s.signals();
  list = list(strcmp({list.causality}, 'output') & strcmp({list.type}, 'Float64'));
  assert(~isempty(list), 'no output of type Float64');
  names = {list(1:min(3, numel(list))).name};
end

function lists(s)
  list = s.signals();
  assert(~isempty(list) && isfield(list, 'unit'), 'no signals, or without units');
end

function reads(s)
  names = some_outputs(s);
  assert(isnumeric(s.get(names{1})), 'no numbers');
end

function refuses(s)
  try
    s.get('no_such_component.y');
  catch reason
    assert(~isempty(strfind(reason.message, 'no_such_component.y')), reason.message);
    return
  end
  error('uuvsim:selftest', 'it was read');
end

function steps(s)
  before = s.time;
  s.step([], 3 * s.step_size, some_outputs(s));
  assert(abs(s.time - before - 3 * s.step_size) < 1e-9, 'time went on by %g s', s.time - before);
end

function steps_compact(s)
  s.layout({}, some_outputs(s));
  before = s.time;
  y = s.step([], s.step_size);
  assert(isvector(y), 'no vector came back');
  assert(abs(s.time - before - s.step_size) < 1e-9, 'time went on by %g s', s.time - before);
end

function runs(s)
  r = s.run(10 * s.step_size, some_outputs(s));
  assert(numel(r.time) >= 10, '%d rows came back', numel(r.time));
  assert(all(diff(r.time) > 0), 'time does not grow');
end

function repeats(s)
  names = some_outputs(s);
  s.layout({}, names);
  id = s.snapshot();
  first = s.step([], 5 * s.step_size);
  s.restore(id);
  second = s.step([], 5 * s.step_size);
  s.restore(id);
  assert(isequaln(first, second), 'the largest difference is %g', max(abs(first - second)));
end

function seconds = round_trip(s, count)
  s.layout({}, some_outputs(s));
  taken = zeros(1, count);
  for k = 1:count
    begin = tic;
    s.step([]);
    taken(k) = toc(begin);
  end
  seconds = median(taken);
end
