function code = hold_code(design)
  % Return the controller of a design as the text of one function that needs no other code:
  %
  %   tau_d = station(eta_d, nu_d, eta, nu)     % one sample; it keeps its own state
  %
  % For a MATLAB Function block (build_controller.m), or any other use of MATLAB code.
  lines = {
    'function tau_d = station(eta_d, nu_d, eta, nu) %#ok<INUSL>'
    '% Designed by design_hold; see docs/connections/connect_simulink.md of uuvsim-cosim.'
    'persistent f z'
    'if isempty(f)'
    '  f = zeros(6, 1);'
    '  z = zeros(6, 1);'
    'end'
    ['K = ' mat2str(design.K, 17) ';']
    ['A_f = ' mat2str(design.A_f, 17) ';']
    ['B_f = ' mat2str(design.B_f, 17) ';']
    ['dt = ' mat2str(design.dt, 17) ';']
    ['limit = ' mat2str(design.limit, 17) ';']
    'e = eta(:) - eta_d(:);'
    'c = cos(eta(6));'
    's = sin(eta(6));'
    'e(1:2) = [c, s; -s, c] * e(1:2);'
    'e(4:6) = atan2(sin(e(4:6)), cos(e(4:6)));'
    'tau_d = -K * [e; nu(:); f; z];'
    'if all(abs(tau_d) < limit)'
    '  z = z + dt * e;'
    'end'
    'tau_d = min(max(tau_d, -limit), limit);'
    'f = A_f * f + B_f * tau_d;'
  };
  code = sprintf('%s\n', lines{:});
end
