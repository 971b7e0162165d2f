function figure_handle = liveplot(session, names, duration, varargin)
  % Plot signals while the co-simulation runs:  uuvsim.liveplot(s, {'hull.nu'}, 20)
  %
  % `duration` is in seconds of simulated time. This client steps, unless the co-simulation streams
  % or 'watch' is true: then it only reads. Options, as name and value:
  %   'every'   communication steps from one point of the plot to the next (10)
  %   'watch'   false
  names = cellstr(names);
  options = struct('every', 10, 'watch', false, 'visible', 'on');
  for k = 1:2:numel(varargin)
    if ~isfield(options, varargin{k})
      error('uuvsim:option', 'uuvsim: an option of liveplot is every or watch.');
    end
    options.(varargin{k}) = varargin{k + 1};
  end
  session.get(names{:});  % an unknown name is refused here, before there is a window
  units = cellfun(@(name) unit_of(session, name), names, 'UniformOutput', false);
  figure_handle = figure('name', 'uuvsim', 'visible', options.visible);
  begin = session.time;
  shown = tic();
  times = [];
  kept = cell(1, numel(names));
  lines = cell(1, numel(names));
  while session.time < begin + duration - session.step_size / 2 && ishandle(figure_handle)
    values = now_or_stepped(session, names, options);
    if ~isempty(times) && session.time <= times(end)
      pause(0.02);  % it streams, and has not gone on yet
      continue
    end
    times(end + 1) = session.time;
    for k = 1:numel(names)
      kept{k}(:, end + 1) = values{k};
    end
    if toc(shown) > 0.1  % drawing is what takes time
      lines = drawn(figure_handle, names, units, [begin, begin + duration], times, kept, lines);
      drawnow();
      shown = tic();
    end
  end
  if ishandle(figure_handle)
    drawn(figure_handle, names, units, [begin, begin + duration], times, kept, lines);
    drawnow();
  end
end

function values = now_or_stepped(session, names, options)
  if options.watch
    session.describe();  % takes the time
  else
    session.step([], options.every * session.step_size, {});
  end
  values = cell(1, numel(names));
  [values{:}] = session.get(names{:});
  values = cellfun(@(v) double(v(:)), values, 'UniformOutput', false);
end

function unit = unit_of(session, name)
  list = session.signals();
  unit = list(strcmp(name, {list.name})).unit;
  unit = strjoin(unique(strtrim(strsplit(unit, ',')), 'stable'), ', ');
end

function lines = drawn(figure_handle, names, units, limits, times, kept, lines)
  for k = 1:numel(names)
    if isempty(lines{k})
      axis_handle = subplot(numel(names), 1, k, 'Parent', figure_handle);
      lines{k} = plot(axis_handle, times, kept{k});
      ylabel(axis_handle, sprintf('%s [%s]', names{k}, units{k}), 'Interpreter', 'none');
      if numel(lines{k}) > 1
        elements = arrayfun(@(i) sprintf('[%d]', i), 1:numel(lines{k}), 'UniformOutput', false);
        legend(axis_handle, elements{:}, 'Location', 'eastoutside');
      end
      xlim(axis_handle, limits);
      grid(axis_handle, 'on');
      if k == numel(names)
        xlabel(axis_handle, 'time [s]');
      end
    else
      for i = 1:numel(lines{k})
        set(lines{k}(i), 'XData', times, 'YData', kept{k}(i, :));
      end
    end
  end
end
