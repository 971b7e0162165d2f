function model = build_simulink(fmus, varargin)
  % Build a Simulink model around one FMU or several (MATLAB with Simulink only):
  %
  %   uuvsim.build_simulink('bluerov2_hold.fmu')                    then: sim('uuvsim_model')
  %   uuvsim.build_simulink({'plant.fmu', 'controller.fmu'}, 'connect', ...
  %                         {'plant.hull_eta', 'controller.eta'; 'controller.tau_d', 'plant.tau_d'})
  %
  % Each FMU becomes a block with the name of its file. Each unconnected input gets a Constant block
  % with the start value, each output a To Workspace block (a timeseries with the variable's name).
  % The solver is discrete, with the fixed step of the co-simulation. Options:
  %   'name'     of the model ('uuvsim_model')
  %   'step'     fixed step [s] (the first FMU's default experiment, else 0.01)
  %   'stop'     stop time [s] (60)
  %   'connect'  cell of two columns, from output to input; each connection delays by one step
  %   'record'   regular expression of the outputs that are recorded ('.')
  % Written from MathWorks' documentation and not yet run in MATLAB (uuvsim.selftest prints what to
  % send in). Ports are assumed to have the order of modelDescription.xml.
  options = struct('name', 'uuvsim_model', 'step', [], 'stop', 60, 'connect', {cell(0, 2)}, ...
                   'record', '.');
  for k = 1:2:numel(varargin)
    if ~isfield(options, varargin{k}) || k == numel(varargin)
      error('uuvsim:option', 'uuvsim: an option of build_simulink is one of %s.', ...
            strjoin(fieldnames(options).', ', '));
    end
    options.(varargin{k}) = varargin{k + 1};
  end
  if isempty(which('new_system'))
    error('uuvsim:matlab_only', 'uuvsim: Simulink is not installed; build_simulink needs it.');
  end
  fmus = cellstr(fmus);
  parts = cellfun(@uuvsim.read_fmu, fmus, 'UniformOutput', false);
  if isempty(options.step)
    options.step = parts{1}.step;
  end

  model = options.name;
  if bdIsLoaded(model)
    error('uuvsim:InputInvalid', ...
          'uuvsim: a model %s is open; close it, or give another ''name''.', model);
  end
  new_system(model);
  load_system('simulink_extras');
  set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', ...
            'FixedStep', sprintf('%.17g', options.step), ...
            'StopTime', sprintf('%.17g', options.stop));
  connected = {};
  for k = 1:numel(parts)
    parts{k} = placed(model, parts{k}, fmus{k}, k);
  end
  for k = 1:size(options.connect, 1)
    connected = [connected, wired(model, parts, options.connect{k, 1}, options.connect{k, 2})];
  end
  for k = 1:numel(parts)
    add_constants(model, parts{k}, connected);
    add_records(model, parts{k}, options.record, options.step);
  end
  open_system(model);
end

function part = placed(model, part, file, number)
  part.block = [model '/' part.name];
  top = 80 + 700 * (number - 1);
  add_block('simulink_extras/FMU Import/FMU', part.block, 'FMUName', file, ...
            'Position', [300, top, 520, top + 600]);
  handles = get_param(part.block, 'PortHandles');
  part.inputs = ports(part.inputs, handles.Inport, part.name, 'inputs');
  part.outputs = ports(part.outputs, handles.Outport, part.name, 'outputs');
end

function variables = ports(variables, handles, name, what)
  % One port for each number, or one for each variable, as this release draws them.
  if numel(handles) ~= numel(variables)
    variables = uuvsim.group_elements(variables);
  end
  if numel(handles) ~= numel(variables)
    error('uuvsim:simulink', ['uuvsim: %s: Simulink shows %d %s, modelDescription.xml %d; ' ...
          'wire this block by hand, and please send us both numbers and the release.'], ...
          name, numel(handles), what, numel(variables));
  end
  for k = 1:numel(handles)
    variables(k).port = handles(k);
  end
end

function targets = wired(model, parts, from, to)
  % A delay and two lines for each pair of ports; a vector may have one port or one per element.
  sources = found(parts, from, 'outputs');
  sinks = found(parts, to, 'inputs');
  if numel(sources) ~= numel(sinks)
    error('uuvsim:simulink', ['uuvsim: %s has %d ports here and %s has %d; use FMUs of one ' ...
          'version of FMI, or wire the two by hand.'], from, numel(sources), to, numel(sinks));
  end
  targets = cell(1, numel(sinks));
  for k = 1:numel(sinks)
    name = matlab.lang.makeValidName(sprintf('%s_to_%s_%d', from, to, k));
    delay = add_block('simulink/Discrete/Unit Delay', [model '/' name], ...
                      'InitialCondition', mat2str(sinks(k).start(:), 17), 'SampleTime', '-1');
    handles = get_param(delay, 'PortHandles');
    add_line(model, sources(k).port, handles.Inport, 'autorouting', 'on');
    add_line(model, handles.Outport, sinks(k).port, 'autorouting', 'on');
    targets{k} = sinks(k).full_name;
  end
end

function chosen = found(parts, name, kind)
  % Return the variable of this name, or the elements of the vector of this name.
  known = {};
  chosen = [];
  for k = 1:numel(parts)
    for variable = reshape(parts{k}.(kind), 1, [])
      variable.full_name = [parts{k}.name '.' variable.name];
      base = regexprep(variable.full_name, '\[[\d,]+\]$', '');
      if strcmp(variable.full_name, name) || strcmp(base, name)
        chosen = [chosen, variable];
      end
      known{end + 1} = base;
    end
  end
  if isempty(chosen)
    error('uuvsim:InputInvalid', 'uuvsim: no %s is called %s; expected one of %s.', ...
          kind(1:end - 1), name, strjoin(unique(known), ', '));
  end
end

function add_constants(model, part, connected)
  for k = 1:numel(part.inputs)
    variable = part.inputs(k);
    if any(strcmp([part.name '.' variable.name], connected))
      continue
    end
    box = get_param(part.block, 'Position');
    top = box(2) + 40 * (k - 1);
    block = add_block('simulink/Sources/Constant', ...
                      [model '/' matlab.lang.makeValidName([part.name '_' variable.name])], ...
                      'Value', mat2str(variable.start(:), 17), 'SampleTime', 'inf', ...
                      'Position', [60, top, 200, top + 24]);
    handles = get_param(block, 'PortHandles');
    add_line(model, handles.Outport, variable.port, 'autorouting', 'on');
  end
end

function add_records(model, part, pattern, step)
  for k = 1:numel(part.outputs)
    variable = part.outputs(k);
    if isempty(regexp(variable.name, pattern, 'once'))
      continue
    end
    box = get_param(part.block, 'Position');
    top = box(2) + 40 * (k - 1);
    name = matlab.lang.makeValidName([part.name '_' variable.name]);
    block = add_block('simulink/Sinks/To Workspace', [model '/' name '_'], ...
                      'VariableName', name, 'SaveFormat', 'Timeseries', ...
                      'SampleTime', sprintf('%.17g', step), ...
                      'Position', [640, top, 860, top + 24]);
    handles = get_param(block, 'PortHandles');
    add_line(model, variable.port, handles.Inport, 'autorouting', 'on');
  end
end
