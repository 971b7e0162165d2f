function r = hold_station(s, design, eta_d, duration)
  % Close the loop in MATLAB for a time [s]: read, compute one sample of hold_law, step.
  %
  %   r = hold_station(s, design, [0; 0; 1; 0; 0; 0], 60);  plot(r.time, r.error(:, 1:3))
  %
  % eta_d is N E D phi theta psi in m and rad. r has time, eta, error, tau: one row per sample.
  names = design.names;
  previous = s.layout(names.input, {names.eta, names.nu});
  again = onCleanup(@() s.layout(previous{:}));
  [eta, nu] = s.get(names.eta, names.nu);
  memory = zeros(12, 1);
  samples = round(duration / design.dt);
  r = struct('time', zeros(samples, 1), 'eta', zeros(samples, 6), 'error', zeros(samples, 6), ...
             'tau', zeros(samples, 6));
  for k = 1:samples
    [u, memory] = hold_law(design, memory, eta, nu, eta_d);
    y = s.step(u, design.dt);
    eta = y(1:6);
    nu = y(7:12);
    r.time(k) = s.time;
    r.eta(k, :) = eta.';
    r.error(k, :) = eta.' - eta_d(:).';
    r.tau(k, :) = u.';
  end
end
