function control(port)
  % Hold a station against a current, with a controller designed for the system that is served at
  % `port` (bluerov2_hold without guidance and controller), and print the errors:
  %
  %   residual R poles P rms E max M final F code D
  %
  % E, M, F are distances from the station [m]; D is the difference of the exported code [N].
  s = uuvsim.connect('port', port, 'lockstep', true, 'lag', 60);
  s.reset();
  design = design_hold(s);
  s.reset();
  s.set('hull.v_c', [0.3, 0.2, 0]);
  r = hold_station(s, design, [0; 0; 1; 0; 0; 0], 60);
  distance = sqrt(sum(r.error(:, 1:3) .^ 2, 2));
  assert(abs(s.time - 60) < 1e-9);
  s.reset();

  folder = tempname();
  mkdir(folder);
  file = fopen(fullfile(folder, 'station.m'), 'w');
  fputs(file, hold_code(design));
  fclose(file);
  addpath(folder);
  memory = zeros(12, 1);
  differs = 0;
  for k = 1:50
    eta = [sin(k); cos(k); 0.1 * k; 0.01 * k; -0.01 * k; 0.1 * k];
    nu = 0.1 * cos(k + (1:6).');
    [u, memory] = hold_law(design, memory, eta, nu, [1; 2; 3; 0; 0; 1]);
    differs = max(differs, max(abs(u - station([1; 2; 3; 0; 0; 1], zeros(6, 1), eta, nu))));
  end
  rmpath(folder);
  confirm_recursive_rmdir(false, 'local');
  rmdir(folder, 's');
  printf('residual %.4g poles %.6g rms %.5g max %.5g final %.5g code %.3g\n', ...
         design.model.residual, max(abs(design.poles)), sqrt(mean(distance .^ 2)), ...
         max(distance), distance(end), differs);
  s.close();
end
