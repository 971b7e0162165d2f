function failed = zenoh_suite(port)
  % Tests of the Zenoh client against a co-simulation of one hull, served at Zenoh's `port`.
  tests = {
    'a value that is set is read back',         @sets_and_gets
    'outputs come in the order of their names', @steps
    'steps are those of the TCP client',        @counts
    'states come as a stream',                  @streams
    'refusals say what would be right',         @refuses
    'a session can be left and entered again',  @comes_back
    'lockstep waits for nobody when alone',     @locksteps
    'arrays of bad arguments are refused',      @refuses_arguments
  };
  failed = 0;
  for k = 1:size(tests, 1)
    z = uuvsim.Zenoh('port', port);
    try
      z.call('reset', {});
      tests{k, 2}(z, port);
      fprintf('ok     %s\n', tests{k, 1});
    catch reason
      failed = failed + 1;
      fprintf('FAILED %s: %s\n', tests{k, 1}, reason.message);
    end
    z.close();
  end
  fprintf('%d of %d passed\n', size(tests, 1) - failed, size(tests, 1));
end

function refused(call, words)
  try
    call();
  catch reason
    assert(~isempty(strfind(reason.message, words)), ...
           '"%s" is not in: %s', words, reason.message);
    return
  end
  error('suite:refused', 'it was not refused (expected: %s)', words);
end

function sets_and_gets(z, port)
  z.set('hull.v_c', [0.1, -0.2, 0], 'hull.tau', 1:6);
  [v_c, tau] = z.get('hull.v_c', 'hull.tau');
  assert(isequal(v_c, [0.1; -0.2; 0]) && isequal(tau, (1:6).'));
end

function steps(z, port)
  [eta, nu] = z.step(10, {'hull.tau', [10, 0, 0, 0, 0, 0]}, {'hull.eta', 'hull.nu'});
  [nu_too, eta_too] = z.get('hull.nu', 'hull.eta');
  assert(nu(1) > 0 && isequal(eta, eta_too) && isequal(nu, nu_too));
end

function counts(z, port)
  z.step(25);
  assert(z.tick == 25 && abs(z.time - 0.25) < 1e-12);
  told = z.call('describe', {});
  assert(strcmp(told.result.system, 'hull_alone'));
end

function streams(z, port)
  z.watch('hull', 50);
  block = [];
  while isempty(block)  % until the co-simulation has noticed that somebody looks
    z.step(1, {'hull.tau', [10, 0, 0, 0, 0, 0]});
    block = z.take('hull');
  end
  last = block;
  while block.tick < z.tick
    block = z.take('hull');
    if isempty(block)
      block = last;
    end
    assert(block.tick >= last.tick);
    last = block;
  end
  assert(isequal(last.nu, z.get('hull.nu')) && abs(last.time - z.time) < 1e-12);
end

function refuses(z, port)
  refused(@() z.get('hull.etta'), 'hull.eta');
  refused(@() z.set('hull.tau', [1, 2]), '6');
  refused(@() z.set('hull.tau', [NaN, 0, 0, 0, 0, 0]), 'hull.tau');
  refused(@() z.set('hull.nu', zeros(6, 1)), 'hull.nu');
  refused(@() z.watch('hul'), 'hull');
  refused(@() z.take('hull'), 'watch');
  refused(@() z.call('stap', {}), 'step');
  refused(@() uuvsim.Zenoh('port', port, 'system', 'other'), 'hull_alone');
  refused(@() uuvsim.Zenoh('prt', port), 'port');
  refused(@() uuvsim.Zenoh('port', 1), 'uuvsim serve');
  z.step(1);
end

function comes_back(z, port)
  z.close();
  refused(@() z.step(1), 'uuvsim.Zenoh()');
  for k = 1:20
    other = uuvsim.Zenoh('port', port);
    other.step(1);
    other.close();
  end
end

function locksteps(z, port)
  z.close();
  lock = uuvsim.Zenoh('port', port, 'lockstep', true, 'lag', 60);
  lock.step(5);
  assert(lock.tick == 5);
  lock.close();
end

function refuses_arguments(z, port)
  refused(@() uuvsim_zenoh('jump'), 'take or close');
  refused(@() uuvsim_zenoh('take', 99, 1), 'closed');
  refused(@() uuvsim_zenoh('open', 5), 'text');
  refused(@() uuvsim_zenoh('open', 'no endpoint'), 'no endpoint');
  h = uuvsim_zenoh('open', sprintf('tcp/127.0.0.1:%d', port));
  close_it = onCleanup(@() uuvsim_zenoh('close', h));
  refused(@() uuvsim_zenoh('get', h, 'a//b', [], [], 1), 'no key');
  refused(@() uuvsim_zenoh('get', h, 'a/b', 'text', [], 1), 'uint8');
  refused(@() uuvsim_zenoh('get', h, 'a/b', [], [], -1), 'timeout');
  refused(@() uuvsim_zenoh('get', h, 'a/b', [], [], 0.2), 'answer');
  refused(@() uuvsim_zenoh('watch', h, 'a/b', 0), '1 to');
  refused(@() uuvsim_zenoh('take', h, 1), 'not watched');
end
