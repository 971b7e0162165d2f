% Turning circles and a zigzag of npsauv.m of MSS, for models/reference/manoeuvres.yaml.
%
%   octave-cli --no-gui manoeuvres_npsauv.m FOLDER_OF_MSS
%
% prints the figures of the unchanged file, and of a copy with four corrections: two signs against
% Newton's law, ten strips at their middles, w - x q in the pitching moment of the cross-flow. Fourth
% order Runge-Kutta; 0.1 s, and 0.02 s for the zigzag. Start: 1.2 m/s, 600 rpm; the rudder is
% moved after 20 s.
1;

function out = manoeuvre(model, rudder, zigzag, seconds, h)
  x = zeros(17, 1); x(1) = 1.2; x(17) = 600; delta = 0;
  out = zeros(round(seconds / h) + 1, 14);
  for i = 1:rows(out)
    t = (i - 1) * h;
    if t >= 20 - 1e-9
      if zigzag == 0 || delta == 0
        delta = deg2rad(rudder);
      elseif delta * (x(12) - sign(-delta) * deg2rad(zigzag)) <= 0 && sign(x(12)) == sign(-delta)
        delta = -delta;
      end
    end
    f = @(x) model(x, [delta; 0; 0; 0; 600]);
    out(i, :) = [t, x(1:12)', delta];
    k1 = f(x); k2 = f(x + h / 2 * k1); k3 = f(x + h / 2 * k2); k4 = f(x + h * k3);
    x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  end
end

function figures(name, model)
  for rudder = [-5, -10, -20]
    o = manoeuvre(model, rudder, 0, 300, 0.1);
    k = 201; psi = abs(unwrap(o(:, 13)));
    a = find(psi >= pi / 2, 1); b = find(psi >= pi, 1);
    radius = hypot(o(end, 2), o(end, 3)) / abs(o(end, 7));
    printf("%s circle %d deg: approach %.4f m/s, steady speed %.4f m/s, rate %.5f rad/s, radius %.3f m,", ...
           name, -rudder, o(k, 2), hypot(o(end, 2), o(end, 3)), o(end, 7), radius);
    printf(" advance %.2f m, transfer %.2f m, tactical diameter %.2f m, depth %.2f m\n", ...
           o(a, 8) - o(k, 8), o(a, 9) - o(k, 9), o(b, 9) - o(k, 9), o(end, 10));
  end
  o = manoeuvre(model, -20, 20, 200, 0.02);
  s = find(diff(o(:, 14)) != 0) + 1;
  printf("%s zigzag: period %.2f s, overshoots [deg]", name, o(s(5), 1) - o(s(3), 1));
  for i = 2:length(s) - 1
    printf(" %.2f", max(abs(rad2deg(o(s(i):s(i + 1), 13)))) - 20);
  end
  printf("\n");
end

mss = argv(){end};
addpath(genpath(fullfile(mss, "LIBRARY")), fullfile(mss, "GNC"), fullfile(mss, "HYDRO"));
file = fullfile(mss, "CRAFT", "AUV", "models", "npsauv.m");
addpath(fileparts(file));
text = fileread(file);
pairs = {"for xL = -L/2:dxL:L/2", "for xL = -L/2+dxL/2:dxL:L/2-dxL/2";
         "drag_term * (w_r + xL * q)", "drag_term * (w_r - xL * q)";
         "+ ...\n      mass * ( v_r*p - u_r*q + xG*p*r", "- ...\n      mass * ( v_r*p - u_r*q + xG*p*r";
         "- ...\n      (Iz-Ix) * p*r", "+ ...\n      (Iz-Ix) * p*r";
         "= npsauv(x, ui, Vc", "= npsauv_corrected(x, ui, Vc"};
text = strrep(text, "\r\n", "\n");
for i = 1:rows(pairs)
  assert(length(strfind(text, pairs{i, 1})) >= 1, pairs{i, 1});
  text = strrep(text, pairs{i, 1}, pairs{i, 2});
end
folder = tempname(); mkdir(folder);
fid = fopen(fullfile(folder, "npsauv_corrected.m"), "w"); fputs(fid, text); fclose(fid);
addpath(folder);
figures("unchanged", @npsauv);
figures("corrected", @npsauv_corrected);
