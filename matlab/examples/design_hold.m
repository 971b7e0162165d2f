function design = design_hold(s, varargin)
  % Design a controller that holds a station, from the linear model of a served system:
  %
  %   s = uuvsim.connect();                      % uuvsim serve open.ssd --paused
  %   design = design_hold(s);
  %
  % The state is position and attitude, velocity, the thrusters' force, and the integral of the
  % error of position and attitude, which takes up an unknown current. One sample is 0.1 s. The
  % vehicle should lie at psi = 0, at rest, as it does after s.reset(). hold_law.m is the law.
  % For another system, pass the names of its signals as options: 'force', 'eta', 'nu', 'input'.
  names = struct('input', 'allocation.tau_d', 'eta', 'hull.eta', 'nu', 'hull.nu', ...
                 'force', 'wrench.tau', 'dt', 0.1);
  for k = 1:2:numel(varargin)
    if ~isfield(names, varargin{k})
      error('uuvsim:option', 'uuvsim: an option of design_hold is input, eta, nu, force or dt.');
    end
    names.(varargin{k}) = varargin{k + 1};
  end
  states = {names.eta, names.nu, names.force};
  push = [10; 10; 10; 1; 1; 1];  % N, N.m: of the size that will be used, beyond the dead bands
  m = uuvsim.linearize(s, names.input, names.eta, 'states', states, 'dt', names.dt, 'step', push);

  % Deviations of x and, summed over time, of eta: z(k+1) = z(k) + dt eta(k).
  A = [m.A, zeros(18, 6); m.dt * [eye(6), zeros(6, 12)], eye(6)];
  B = [m.B; zeros(6, 6)];
  % Bryson's rule: one over the square of the largest acceptable value of each state and force.
  eta = [0.1; 0.1; 0.1; 0.1; 0.1; 0.05];    % m, rad
  nu = [0.3; 0.3; 0.3; 0.5; 0.5; 0.3];      % m/s, rad/s
  sum_of_eta = [0.1; 0.1; 0.1; 1; 1; 0.1];  % m.s, rad.s
  tau = [40; 40; 40; 10; 10; 10];           % N, N.m
  Q = diag([eta; nu; inf(6, 1); sum_of_eta] .^ -2);
  R = diag(tau .^ -2);
  K = lqr_gain(A, B, Q, R);
  design = struct('K', K, 'A_f', m.A(13:18, 13:18), 'B_f', m.B(13:18, :), ...
                  'dt', m.dt, 'limit', 85, 'names', names, 'model', m, ...
                  'poles', eig(A - B * K));
end
