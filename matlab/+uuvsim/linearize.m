function model = linearize(session, inputs, outputs, varargin)
  % Return A, B, C, D in discrete time around the present state, by finite differences:
  %
  %   m = uuvsim.linearize(s, {'hull.tau'}, {'hull.nu'})
  %
  % x and y are deviations from the present trajectory. Inputs are held over 'dt', by default one
  % communication step:
  %
  %   x(k+1) = A x(k) + B u(k),    y(k+1) = C x(k+1) + D u(k)
  %
  % The state x consists of the signals in 'states' (by default the outputs). Each input is changed
  % up and down for one step, the free motion after it is recorded, and A is the least-squares fit.
  % The fit is exact for a linear system whose states are all named and can all be excited:
  % model.residual (relative) and model.rank (of numel(model.state_names)) measure this. Sensor
  % noise cancels, as it is the same in every run from one snapshot. The session returns to its
  % state at the end.
  %
  % Options, as name and value:
  %   'states'   names of the signals in x
  %   'step'     change of the inputs, one number or one for each input element (1e-4)
  %   'dt'       sample time of the model [s]: that of the planned controller, longer than the
  %              delay from command to force (one communication step)
  %   'steps'    samples that are recorded (twice the states, at least 20)
  %
  % With MATLAB's Control System Toolbox or Octave's control: ss(m.A, m.B, m.C, m.D, m.dt).
  inputs = reshape(cellstr(inputs), 1, []);
  outputs = reshape(cellstr(outputs), 1, []);
  options = struct('states', {outputs}, 'step', 1e-4, 'dt', session.step_size, ...
                   'steps', []);
  for k = 1:2:numel(varargin)
    if ~isfield(options, varargin{k})
      error('uuvsim:option', 'uuvsim: an option of linearize is states, step, dt or steps.');
    end
    options.(varargin{k}) = varargin{k + 1};
  end
  states = reshape(cellstr(options.states), 1, []);

  id = session.snapshot();
  back = onCleanup(@() session.restore(id));
  [u0, input_names] = column_of(session, inputs);
  [x0, state_names] = column_of(session, states);
  [y0, output_names] = column_of(session, outputs);
  steps = options.steps;
  if isempty(steps)
    steps = max(20, 2 * numel(x0));
  end
  size_of_step = options.step .* ones(numel(u0), 1);
  previous = session.layout(inputs, [states, outputs]);
  again = onCleanup(@() session.layout(previous{:}));

  [X1, Y1, X, Xnext, Y] = deal([]);
  for j = 1:numel(u0)
    push = zeros(numel(u0), 1);
    push(j) = size_of_step(j);
    up = response(session, id, u0, push, options.dt, steps);
    down = response(session, id, u0, -push, options.dt, steps);
    both = (up - down) / (2 * size_of_step(j));
    x = both(1:numel(x0), :);
    y = both(numel(x0) + 1:end, :);
    X1 = [X1, x(:, 1)];
    Y1 = [Y1, y(:, 1)];
    X = [X, x(:, 1:end - 1)];
    Xnext = [Xnext, x(:, 2:end)];
    Y = [Y, y(:, 2:end)];
  end

  scale = max(abs([X1, X, Xnext]), [], 2);
  scale(scale == 0) = 1;
  scaled = bsxfun(@rdivide, X, scale);
  tolerance = 1e-7 * max([norm(scaled), realmin]);
  inverse = pinv(scaled, tolerance);
  model = struct();
  model.A = bsxfun(@rdivide, Xnext * inverse, scale.');
  model.B = X1;
  model.C = bsxfun(@rdivide, Y * pinv(bsxfun(@rdivide, Xnext, scale), tolerance), scale.');
  model.D = Y1 - model.C * X1;
  model.D(abs(model.D) < 1e-6 * max([abs(Y1(:)); realmin])) = 0;
  model.dt = options.dt;
  model.state_names = state_names;
  model.input_names = input_names;
  model.output_names = output_names;
  model.x0 = x0;
  model.u0 = u0;
  model.y0 = y0;
  misfit = bsxfun(@rdivide, Xnext - model.A * X, scale);
  model.residual = norm(misfit, 'fro') / max(norm(bsxfun(@rdivide, Xnext, scale), 'fro'), realmin);
  model.rank = rank(scaled, tolerance);
  if model.residual > 1e-2
    warning('uuvsim:linearize', ...
            ['uuvsim: the named states leave %.2g of the response unexplained: there are ' ...
             'others (of thrusters, delays, filters); name them with ''states'', or make ' ...
             '''dt'' longer.'], model.residual);
  end
end

function [numbers, names] = column_of(session, signals)
  numbers = [];
  names = {};
  for k = 1:numel(signals)
    value = double(session.get(signals{k}));
    numbers = [numbers; value(:)];
    if numel(value) == 1
      names{end + 1} = signals{k};
    else
      for i = 1:numel(value)
        names{end + 1} = sprintf('%s[%d]', signals{k}, i);
      end
    end
  end
end

function rows = response(session, id, u0, push, dt, steps)
  session.restore(id);
  first = session.step(u0 + push, dt);
  rows = zeros(numel(first), steps);
  rows(:, 1) = first;
  for k = 2:steps
    rows(:, k) = session.step(u0, dt);
  end
end
