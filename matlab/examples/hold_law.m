function [u, memory] = hold_law(design, memory, eta, nu, eta_d)
  % Compute one sample of the controller that design_hold designs:  u = -K [e; nu; f; z].
  %
  % e is the error of position and attitude, ahead and to starboard instead of north and east, as
  % the model is linearised at psi = 0. f is the thrusters' force that the model predicts from the
  % commands, z the integral of e. `memory` is [f; z]; begin with zeros(12, 1).
  e = eta(:) - eta_d(:);
  c = cos(eta(6));
  s = sin(eta(6));
  e(1:2) = [c, s; -s, c] * e(1:2);
  e(4:6) = atan2(sin(e(4:6)), cos(e(4:6)));
  f = memory(1:6);
  z = memory(7:12);
  u = -design.K * [e; nu(:); f; z];
  if all(abs(u) < design.limit)
    z = z + design.dt * e;  % else it would wind up
  end
  u = min(max(u, -design.limit), design.limit);
  memory = [design.A_f * f + design.B_f * u; z];
end
