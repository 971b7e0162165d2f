function [K, P] = lqr_gain(A, B, Q, R)
  % Return the gain of u = -K x that minimises the sum of x'Qx + u'Ru over x(k+1) = A x + B u.
  %
  %   K = lqr_gain(A, B, Q, R)
  %
  % The result is that of dlqr in MATLAB's Control System Toolbox and Octave's control package. P
  % solves P = A'P A - A'P B (R + B'P B)^-1 B'P A + Q by doubling: n iterations correspond to 2^n
  % of the plain recursion (Anderson 1978; Chu, Fan, Lin 2005).
  n = size(A, 1);
  if ~isequal(size(A), [n, n], size(Q)) || size(B, 1) ~= n || ~isequal(size(R), size(B, 2) * [1, 1])
    error('uuvsim:InputInvalid', ['uuvsim: A is %d x %d, B %d x %d, Q %d x %d, R %d x %d; ' ...
          'expected n x n, n x m, n x n, m x m.'], size(A), size(B), size(Q), size(R));
  end
  F = A;
  G = (B / R) * B.';
  P = Q;
  for k = 1:60
    W = eye(n) + G * P;
    if ~(rcond(W) > eps()) || norm(P, 1) > 1e30
      break
    end
    step = F.' * (P / W) * F;
    G = G + F * (W \ G) * F.';
    F = F * (W \ F);
    P = P + (step + step.') / 2;
    if norm(step, 1) <= 1e-13 * norm(P, 1)
      K = (R + B.' * P * B) \ (B.' * P * A);
      return
    end
  end
  error('uuvsim:lqr', ['uuvsim: no gain was found: some part of x that grows cannot be moved ' ...
                       'by u, or not be seen by Q.']);
end
