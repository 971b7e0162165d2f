function lockstep(port, count)
  % Hold the barrier of a co-simulation for a number of steps, and print the final state.
  s = uuvsim.connect('port', port, 'lockstep', true, 'lag', 60, 'timeout', 60);
  s.layout('hull.tau', 'hull.nu');
  for k = 1:count
    y = s.step([0; 0; 0; 0; 0; 1]);
  end
  fprintf('tick %d nu %.17g %.17g\n', s.tick, y(1), y(6));
  s.close();
end
