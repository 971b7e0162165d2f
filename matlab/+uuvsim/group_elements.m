function grouped = group_elements(variables)
  % Join tau[1], tau[2], ... of read_fmu's inputs or outputs to one variable tau.
  %
  %   part = uuvsim.read_fmu(file);  inputs = uuvsim.group_elements(part.inputs);
  grouped = [];
  for k = 1:numel(variables)
    variable = variables(k);
    base = regexprep(variable.name, '\[[\d,]+\]$', '');
    same = [];
    if ~isempty(grouped)
      same = find(strcmp(base, {grouped.name}));
    end
    if isempty(same)
      variable.name = base;
      grouped = [grouped, variable];
    else
      grouped(same).start = [grouped(same).start; variable.start];
    end
  end
end
