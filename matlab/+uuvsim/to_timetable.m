function result = to_timetable(results)
  % Return the results of a run as a timetable with a variable for each signal (MATLAB only).
  %
  %   T = uuvsim.to_timetable(s.run(10));
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    error('uuvsim:matlab_only', ...
          'uuvsim: GNU Octave has no timetable; use the struct that s.run gives as it is.');
  end
  [names, values] = columns(rmfield(results, 'time'), '');
  result = timetable(values{:}, 'RowTimes', seconds(results.time), 'VariableNames', names);
end

function [names, values] = columns(given, prefix)
  names = {};
  values = {};
  fields = fieldnames(given);
  for k = 1:numel(fields)
    value = given.(fields{k});
    if isstruct(value)
      [inner, inner_values] = columns(value, [prefix fields{k} '_']);
      names = [names, inner];
      values = [values, inner_values];
    else
      names{end + 1} = [prefix fields{k}];
      values{end + 1} = value;
    end
  end
end
