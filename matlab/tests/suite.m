function failed = suite(port)
  % The client's own test suite, against a co-simulation of one hull that is served at `port`:
  %
  %   uuvsim serve <a system with a component hull of model:bluerov2_heavy, nothing else>
  %   addpath matlab matlab/tests; suite(7448)
  %
  % Prints one line for each test, and returns the number of tests that failed.
  tests = {
    'a value that is set is read back',               @sets_and_gets
    'several values are read at once',                @gets_several
    'a containers.Map and a cell set as a struct',    @sets_in_three_ways
    'a list of signals has units and shapes',         @lists
    'outputs come as a struct of arrays',             @steps_with_struct
    'vectors and structs step to the same bits',      @steps_with_vector
    'time goes on by what was asked for',             @time_goes_on
    'a run gives one row a communication point',      @runs
    'a restored snapshot repeats bit by bit',         @restores
    'a reset goes back to the start',                 @resets
    'start values are taken by a reset',              @resets_with_start
    'streaming goes on until it is paused',           @streams
    'an unknown name is refused with near names',     @refuses_names
    'a wrong shape is refused with the right one',    @refuses_shapes
    'an input keeps to its own shape',                @keeps_inputs_apart
    'a text is no input of a step',                   @refuses_texts
    'not a number is refused',                        @refuses_nan
    'an output cannot be set',                        @refuses_outputs
    'a time that is no whole step is refused',        @refuses_dt
    'an unknown snapshot is refused',                 @refuses_snapshots
    'a connection lives on after a refusal',          @lives_on
    'a closed session says what to do',               @refuses_when_closed
    'an unreachable port says what to do',            @refuses_to_connect
    'a wrong option is refused',                      @refuses_options
    'a linear model predicts the response',           @linearizes
    'linearizing leaves the session as it was',       @linearizes_quietly
    'states that are left out are warned of',         @warns_of_states
    'a linear model may have a longer sample',       @linearizes_slower
    'a live plot shows what came, with its units',   @plots
    'a live plot refuses unknown names',             @plots_nothing
    'the self test passes',                           @tests_itself
  };
  failed = 0;
  for k = 1:size(tests, 1)
    s = uuvsim.connect('port', port);
    try
      s.reset();
      tests{k, 2}(s, port);
      fprintf('ok     %s\n', tests{k, 1});
    catch reason
      failed = failed + 1;
      fprintf('FAILED %s: %s\n', tests{k, 1}, reason.message);
    end
    s.close();
  end
  fprintf('%d of %d passed\n', size(tests, 1) - failed, size(tests, 1));
end

function refused(call, words)
  % Check that a call is refused with these words in its message.
  try
    call();
  catch reason
    assert(~isempty(strfind(reason.message, words)), ...
           '"%s" is not in: %s', words, reason.message);
    return
  end
  error('suite:refused', 'it was not refused (expected: %s)', words);
end

function sets_and_gets(s, port)
  s.set('hull.v_c', [0.1, -0.2, 0]);
  assert(isequal(s.get('hull.v_c'), [0.1; -0.2; 0]));
  s.set('hull.v_c', '[3.6, 0, 0] km/h');
  assert(isequal(s.get('hull.v_c'), [1; 0; 0]));
  refused(@() s.set('hull.v_c', [1i, 0, 0]), 'real numbers');
  refused(@() s.set(5, [1, 0, 0]), 'signal''s name');
  assert(~isempty(strfind(evalc('s.signals(''no_such'')'), 'no signal has')));
end

function gets_several(s, port)
  [eta, nu] = s.get('hull.eta', 'hull.nu');
  both = s.get({'hull.eta', 'hull.nu'});
  assert(isequal(size(eta), [6, 1]));
  assert(isequal(eta, both.hull.eta) && isequal(nu, both.hull.nu));
end

function sets_in_three_ways(s, port)
  s.set(struct('hull', struct('v_c', [1, 2, 3])));
  assert(isequal(s.get('hull.v_c'), [1; 2; 3]));
  s.set(containers.Map({'hull.v_c'}, {[4, 5, 6]}));
  assert(isequal(s.get('hull.v_c'), [4; 5; 6]));
  s.set('hull.v_c', [7; 8; 9], 'hull.tau', zeros(6, 1));
  assert(isequal(s.get('hull.v_c'), [7; 8; 9]));
end

function lists(s, port)
  list = s.signals('^hull\.(tau|eta)$');
  assert(numel(list) == 2);
  tau = list(strcmp({list.name}, 'hull.tau'));
  assert(strcmp(tau.causality, 'input') && tau.settable && tau.shape == 6);
  assert(~isempty(strfind(tau.unit, 'N.m')));
end

function steps_with_struct(s, port)
  u.hull.tau = [10; 0; 0; 0; 0; 0];
  y = s.step(u, 0.1);
  assert(y.hull.nu(1) > 0 && y.hull.eta(1) > 0);
  assert(isequal(size(y.hull.q), [4, 1]));
  y = s.step([], 0.1, {'hull.nu'});
  assert(isequal(fieldnames(y.hull), {'nu'}));
end

function steps_with_vector(s, port)
  push = [10; 1; -2; 0.1; 0; 1];
  u.hull.tau = push;
  for k = 1:10
    y = s.step(u);
  end
  s.reset();
  s.layout('hull.tau', {'hull.eta', 'hull.nu'});
  for k = 1:10
    v = s.step(push);
  end
  assert(isequal(v, [y.hull.eta; y.hull.nu]));
  s.layout();
  y = s.step(u);
  assert(isstruct(y));
end

function time_goes_on(s, port)
  s.step([], 0.25);
  assert(abs(s.time - 0.25) < 1e-12 && s.tick == 25);
  s.step();
  assert(s.tick == 26);
end

function runs(s, port)
  s.set('hull.tau', [10, 0, 0, 0, 0, 0]);
  r = s.run(1, {'hull.nu', 'hull.eta'});
  assert(abs(r.time(end) - 1) < 1e-9 && all(abs(diff(r.time) - 0.01) < 1e-9));
  assert(isequal(size(r.hull.nu), [numel(r.time), 6]));
  assert(all(diff(r.hull.eta(:, 1)) >= 0) && r.hull.nu(end, 1) > 0);
  assert(isequal(r.hull.nu(end, :).', s.get('hull.nu')));
end

function restores(s, port)
  s.set('hull.tau', [10, 0, 0, 0, 0, 1]);
  s.step([], 0.5);
  id = s.snapshot();
  first = s.step([], 0.5);
  s.restore(id);
  assert(abs(s.time - 0.5) < 1e-12);
  second = s.step([], 0.5);
  assert(isequal(first, second));
end

function resets(s, port)
  before = s.get('hull.eta');
  s.step(struct('hull', struct('tau', [10, 0, 0, 0, 0, 0])), 1);
  assert(~isequal(s.get('hull.eta'), before));
  s.reset();
  assert(isequal(s.get('hull.eta'), before) && s.time == 0);
end

function resets_with_start(s, port)
  s.reset(3, 'hull.nu_0', [1, 0, 0, 0, 0, 0]);
  nu = s.get('hull.nu');
  assert(abs(nu(1) - 1) < 1e-12);
  s.reset(0, 'hull.nu_0', zeros(6, 1));
end

function streams(s, port)
  s.stream(20);
  before = s.time;
  for k = 1:1000
    s.describe();
    if s.time > before
      break
    end
  end
  s.pause();
  assert(s.time > before);
  s.step();
end

function refuses_names(s, port)
  refused(@() s.get('hull.etta'), 'hull.eta');
  refused(@() s.set('hul.tau', 1), 'hull.tau');
  refused(@() s.step(struct('hull', struct('taw', 1))), 'hull.tau');
end

function refuses_shapes(s, port)
  refused(@() s.set('hull.tau', [1, 2]), '6');
  refused(@() s.step(struct('hull', struct('tau', [1, 2]))), '6');
end

function keeps_inputs_apart(s, port)
  % Nine numbers in all, as the two variables have together, but not three and six.
  u.hull.v_c = [0.1, 0.2];
  u.hull.tau = [0.3, 10, 0, 0, 0, 0, 0];
  refused(@() s.step(u), 'hull.v_c: an array of 1 x 2 was given; expected 3 real numbers');
  refused(@() s.set(u), 'hull.v_c: an array of 1 x 2 was given; expected 3 real numbers');
  u.hull.v_c = [0.1, 0.2, 0];
  refused(@() s.step(u), 'hull.tau: an array of 1 x 7');
  refused(@() s.step({'hull.tau', zeros(2, 3)}), 'hull.tau: an array of 2 x 3');
  refused(@() s.step({'hull.tau', int64([2^53, 0, 0, 0, 0, 0])}), 'from 2^53');
  refused(@() s.step(struct('hull', struct('tau', {1, 2}))), 'an array of 2 structs');
  assert(s.tick == 0 && isequal(s.get('hull.tau'), zeros(6, 1)));
  s.step({'hull.v_c', int32([1; 2; 3]), 'hull.tau', true(1, 6)});
  assert(isequal(s.get('hull.v_c'), [1; 2; 3]) && isequal(s.get('hull.tau'), ones(6, 1)));
end

function refuses_texts(s, port)
  refused(@() s.step({'hull.v_c', 'abc'}), 'hull.v_c: a char was given; expected 3 real numbers');
  refused(@() s.set('hull.v_c', 'abc'), 'hull.v_c');
  refused(@() s.step({'hull.v_c', [1i, 0, 0]}), 'hull.v_c: a complex array');
  assert(isequal(s.get('hull.v_c'), zeros(3, 1)));
end

function refuses_nan(s, port)
  refused(@() s.set('hull.tau', [NaN, 0, 0, 0, 0, 0]), 'hull.tau');
end

function refuses_outputs(s, port)
  refused(@() s.set('hull.nu', zeros(6, 1)), 'hull.nu');
end

function refuses_dt(s, port)
  refused(@() s.step([], 0.013), 'whole multiple');
  refused(@() s.step([], NaN), 'whole multiple');
  refused(@() s.run(-1), 'whole multiple');
end

function refuses_snapshots(s, port)
  refused(@() s.restore('no_such'), 'no_such');
  refused(@() s.restore(), 's.snapshot gave');
end

function lives_on(s, port)
  refused(@() s.get('x'), 'x');
  s.layout('hull.tau', 'hull.nu');
  refused(@() s.step([NaN; 0; 0; 0; 0; 0]), 'hull.tau');
  s.step(zeros(6, 1));
  assert(s.tick == 1);
end

function refuses_when_closed(s, port)
  s.close();
  refused(@() s.get('hull.nu'), 'uuvsim.connect()');
  s.close();
end

function refuses_to_connect(s, port)
  refused(@() uuvsim.connect('port', 1), 'uuvsim serve');
end

function refuses_options(s, port)
  refused(@() uuvsim.connect('prt', 1), 'port');
  refused(@() uuvsim.connect('port'), 'pairs');
  refused(@() uuvsim.connect('port', port, 'lockstep', 'yes'), 'true or false');
  refused(@() s.run(), 'number of seconds');
  refused(@() s.run('long'), 'number of seconds');
  refused(@() s.replace('hull'), 'a component and a source');
end

function linearizes(s, port)
  s.set('hull.tau', [20, 0, 0, 0, 0, 0]);
  s.step([], 20);
  m = uuvsim.linearize(s, 'hull.tau', {'hull.eta', 'hull.nu'}, 'step', 1e-3);
  assert(isequal(size(m.A), [12, 12]) && isequal(size(m.B), [12, 6]));
  assert(strcmp(m.input_names{6}, 'hull.tau[6]') && strcmp(m.state_names{7}, 'hull.nu[1]'));
  assert(m.residual < 1e-4, 'residual %g', m.residual);
  assert(all(m.D(:) == 0));
  assert(max(max(abs(m.C - eye(12)))) < 1e-4, 'C is off by %g', max(max(abs(m.C - eye(12)))));
  push = 1e-2 * [1; -1; 1; 0.1; -0.1; 0.5];
  s.layout('hull.tau', {'hull.eta', 'hull.nu'});
  id = s.snapshot();
  x = zeros(12, 1);
  for k = 1:20
    free = s.step(m.u0);
  end
  s.restore(id);
  for k = 1:20
    pushed = s.step(m.u0 + push);
    x = m.A * x + m.B * push;
  end
  off = norm(pushed - free - x) / norm(x);
  assert(off < 1e-3, 'the prediction is off by %g', off);
end

function linearizes_slower(s, port)
  signals = {'hull.eta', 'hull.nu'};
  slow = uuvsim.linearize(s, 'hull.tau', signals, 'step', 1e-3, 'dt', 0.05);
  fast = uuvsim.linearize(s, 'hull.tau', signals, 'step', 1e-3);
  assert(slow.dt == 0.05 && fast.dt == 0.01);
  off = norm(slow.B - (eye(12) + fast.A + fast.A^2 + fast.A^3 + fast.A^4) * fast.B);
  assert(off < 1e-3 * norm(slow.B), 'B is off by %g', off / norm(slow.B));
  refused(@() uuvsim.linearize(s, 'hull.tau', signals, 'dt', 0.013), 'whole multiple');
end

function plots(s, port)
  handle = uuvsim.liveplot(s, {'hull.nu'}, 0.5, 'visible', 'off');
  close_it = onCleanup(@() close(handle));
  shown = findobj(handle, 'type', 'axes');
  labels = get(shown, 'ylabel');
  if iscell(labels)
    labels = labels{end};
  end
  assert(strcmp(get(labels, 'string'), 'hull.nu [m/s, rad/s]'), get(labels, 'string'));
  curves = findobj(handle, 'type', 'line');
  counts = arrayfun(@(h) numel(get(h, 'xdata')), curves);
  assert(sum(counts == 5) >= 6, 'curves of %s points', mat2str(counts));
  assert(abs(s.time - 0.5) < 1e-9);
end

function plots_nothing(s, port)
  refused(@() uuvsim.liveplot(s, {'hull.mu'}, 1), 'hull.nu');
end

function linearizes_quietly(s, port)
  s.step([], 0.5);
  before = s.get({'hull.eta', 'hull.tau'});
  uuvsim.linearize(s, 'hull.tau', {'hull.eta', 'hull.nu'});
  assert(isequal(before, s.get({'hull.eta', 'hull.tau'})) && s.tick == 50);
  assert(isstruct(s.step()));
end

function warns_of_states(s, port)
  s.set('hull.tau', [20, 0, 0, 0, 0, 0]);
  s.step([], 1);
  state = warning('off', 'uuvsim:linearize');
  back = onCleanup(@() warning(state));
  lastwarn('');
  m = uuvsim.linearize(s, 'hull.tau', 'hull.eta');
  assert(m.residual > 1e-2, 'residual %g', m.residual);
end

function tests_itself(s, port)
  assert(uuvsim.selftest('port', port));
end
