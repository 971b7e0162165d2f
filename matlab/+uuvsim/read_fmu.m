function part = read_fmu(file)
  % Read the ports of an FMU: name, step [s], inputs and outputs (name, start); FMI 2 and 3.
  %
  %   part = uuvsim.read_fmu('bluerov2_hold.fmu');  {part.inputs.name}
  if exist(file, 'file') ~= 2
    error('uuvsim:InputInvalid', 'uuvsim: %s: no such file; expected an .fmu.', file);
  end
  folder = tempname();
  mkdir(folder);
  leave = onCleanup(@() gone(folder));
  try
    unzip(file, folder);
    text = fileread(fullfile(folder, 'modelDescription.xml'));
  catch
    error('uuvsim:InputInvalid', ...
          'uuvsim: %s: expected an FMU, a zip archive with a modelDescription.xml.', file);
  end
  text = regexprep(text, '<!--.*?-->', '');
  [~, name] = fileparts(file);
  part = struct('name', matlab.lang.makeValidName(name), 'step', 0.01, ...
                'version', attribute(text, 'fmiModelDescription', 'fmiVersion', ''), ...
                'inputs', [], 'outputs', []);
  step = str2double(attribute(text, 'DefaultExperiment', 'stepSize', ''));
  if step > 0
    part.step = step;
  end
  body = regexp(text, '<ModelVariables>(.*)</ModelVariables>', 'tokens', 'once');
  if isempty(body)
    error('uuvsim:InputInvalid', ...
          'uuvsim: %s: its modelDescription.xml has no ModelVariables.', file);
  end
  tags = regexp(body{1}, '<\w+\s[^<>]*name="[^<>]*>', 'match');
  starts = regexp(body{1}, '<\w+\s[^<>]*name="[^<>]*>');
  ends = [starts(2:end) - 1, numel(body{1})];
  kinds = {'input', 'output'};
  for k = 1:numel(tags)
    causality = named(tags{k}, 'causality');
    where = find(strcmp(causality, kinds));
    if ~isempty(where)
      inside = body{1}(starts(k):ends(k));
      start = regexp(inside, '\sstart="([^"]*)"', 'tokens', 'once');
      numbers = 0;
      if ~isempty(start)
        numbers = sscanf(strrep(strrep(start{1}, 'false', '0'), 'true', '1'), '%f');
      end
      dimension = regexp(inside, '<Dimension\s+start="(\d+)"', 'tokens');
      count = prod(cellfun(@(d) str2double(d{1}), dimension));
      if numel(numbers) ~= count
        numbers = repmat([numbers(1:min(1, end)); zeros(isempty(numbers), 1)], count, 1);
      end
      field = [kinds{where} 's'];
      variable = struct('name', named(tags{k}, 'name'), 'start', numbers(:), 'port', []);
      part.(field) = [part.(field), variable];
    end
  end
end

function value = attribute(text, element, name, default)
  value = default;
  tag = regexp(text, ['<' element '\s[^>]*>'], 'match', 'once');
  found = named(tag, name);
  if ~isempty(found)
    value = found;
  end
end

function value = named(tag, name)
  value = regexp(tag, ['\s' name '="([^"]*)"'], 'tokens', 'once');
  if isempty(value)
    value = '';
  else
    value = value{1};
  end
end

function gone(folder)
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    confirm_recursive_rmdir(false, 'local');
  end
  rmdir(folder, 's');
end
