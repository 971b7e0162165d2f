function value = numbers_of(name, value, info)
  % Return a value as double, checked against its variable; raises an error that names it.
  %
  % `info` has the variable's shape, [] if that is unknown. A variable with one index
  % takes a row or a column; one with more takes an array of exactly its size. Integers for a
  % variable of type Int64 or UInt64 stay integers of its class, which are exact.
  expected = 'real numbers';
  shape = [];
  if ~isempty(info)
    shape = reshape(info.shape, 1, []);
    expected = sprintf('%d real numbers', prod(shape));
    if numel(shape) > 1
      expected = [strjoin(arrayfun(@(n) sprintf('%d', n), shape, 'UniformOutput', false), ...
                          ' x '), ' real numbers'];
    end
  end
  if ~(isnumeric(value) || islogical(value)) || ~isreal(value)
    what = class(value);
    if ~isreal(value)
      what = 'complex array';
    end
    error('uuvsim:InputInvalid', ['uuvsim: %s: a %s was given; expected %s. A text with a unit ' ...
          'is taken by s.set.'], name, what, expected);
  end
  kind = '';
  if ~isempty(info) && isfield(info, 'type')
    kinds = struct('Int64', 'int64', 'UInt64', 'uint64', 'Enumeration', 'int64');
    if isfield(kinds, info.type)
      kind = kinds.(info.type);
    end
  end
  if isinteger(value) && ~isempty(kind)
    exact = cast(value, kind);
    if ~isequal(cast(exact, class(value)), value)
      error('uuvsim:InputInvalid', 'uuvsim: %s: an integer was given that does not fit %s.', ...
            name, info.type);
    end
    value = exact;
  elseif isinteger(value) && any(abs(double(value(:))) >= 2^53)
    error('uuvsim:InputInvalid', ...
          ['uuvsim: %s: a whole number from 2^53 on was given; doubles, which are sent, are ' ...
           'not exact there.'], name);
  else
    value = full(double(value));
  end
  if isempty(info)
    return
  end
  if numel(shape) < 2
    fits = numel(value) == prod(shape) && (isempty(value) || isvector(value));
  else
    while numel(shape) > 2 && shape(end) == 1
      shape(end) = [];  % as MATLAB has it
    end
    fits = isequal(size(value), shape);
  end
  if ~fits
    given = arrayfun(@(n) sprintf('%d', n), size(value), 'UniformOutput', false);
    error('uuvsim:InputInvalid', 'uuvsim: %s: an array of %s was given; expected %s.', ...
          name, strjoin(given, ' x '), expected);
  end
end
