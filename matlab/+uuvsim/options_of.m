function options = options_of(options, given, what)
  % Return defaults updated by options as name and value, also as MATLAB passes f(port=7448).
  %
  % `options` is a struct of defaults, `given` a cell of names and values, `what` the function's
  % name for messages. A text of MATLAB's class string becomes one of class char.
  if mod(numel(given), 2) ~= 0
    error('uuvsim:option', 'uuvsim: options of %s come in pairs, as in %s(''port'', 7448).', ...
          what, what);
  end
  known = fieldnames(options);
  for k = 1:2:numel(given)
    name = plain(given{k});
    if ~ischar(name) || ~any(strcmp(name, known))
      error('uuvsim:option', 'uuvsim: an option of %s is one of %s.', what, ...
            strjoin(known.', ', '));
    end
    options.(name) = plain(given{k + 1});
  end
end

function value = plain(value)
  if isa(value, 'string') && numel(value) == 1
    value = char(value);
  end
end
