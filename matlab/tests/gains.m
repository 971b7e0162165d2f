function gains()
  % Test lqr_gain against a closed form and the plain recursion, and its errors.
  % One state: P = 1 + P - P^2/(1 + P), so P is the golden ratio and K = P/(1 + P).
  K = lqr_gain(1, 1, 1, 1);
  golden = (1 + sqrt(5)) / 2;
  assert(abs(K - golden / (1 + golden)) < 1e-12);

  A = [1, 0.1, 0; 0, 0.9, 0.1; 0, 0, 0.7];
  B = [0, 0; 0.1, 0; 0, 0.3];
  Q = diag([4, 1, 0]);
  R = [1, 0.2; 0.2, 2];
  P = Q;
  for k = 1:5000
    P = A.' * P * A - A.' * P * B * ((R + B.' * P * B) \ (B.' * P * A)) + Q;
  end
  assert(norm(lqr_gain(A, B, Q, R) - (R + B.' * P * B) \ (B.' * P * A)) < 1e-9);

  refused(@() lqr_gain(eye(2), [1; 0; 0], eye(2), 1), 'n x m');
  refused(@() lqr_gain(2 * eye(2), [1; 0], eye(2), 1), 'cannot be moved');
  disp('gains ok');
end

function refused(call, words)
  try
    call();
  catch reason
    assert(~isempty(strfind(reason.message, words)), '%s', reason.message);
    return
  end
  error('gains:refused', 'it was not refused: %s', words);
end
