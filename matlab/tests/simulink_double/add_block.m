function handle = add_block(source, path, varargin)
  % Simulink's, as a double: refuses sources, parents, names and parameters that are not known.
  known = {
    'simulink_extras/FMU Import/FMU', {'FMUName'}
    'simulink/Sources/Constant', {'Value', 'SampleTime'}
    'simulink/Sources/In1', {'PortDimensions', 'OutDataTypeStr', 'SampleTime'}
    'simulink/Sinks/Out1', {}
    'simulink/Sinks/To Workspace', {'VariableName', 'SaveFormat', 'SampleTime'}
    'simulink/Discrete/Unit Delay', {'InitialCondition', 'SampleTime'}
    'simulink/Signal Routing/Demux', {'Outputs'}
    'simulink/User-Defined Functions/MATLAB Function', {}
    'simulink/User-Defined Functions/MATLAB System', ...
      {'System', 'Inputs', 'Outputs', 'SampleTime', 'Port'}
  };
  row = find(strcmp(source, known(:, 1)));
  assert(numel(row) == 1, 'add_block: no source %s', source);
  state = simulink_state();
  parts = strsplit(path, '/');
  assert(numel(parts) == 2 && any(strcmp(parts{1}, state.models)), 'add_block: %s', path);
  paths = cellfun(@(block) block.path, state.blocks, 'UniformOutput', false);
  assert(~any(strcmp(path, paths)), 'add_block: %s is there', path);
  block = struct('path', path, 'source', source, 'known', {known{row, 2}}, ...
                 'parameters', struct('Position', [0, 0, 30, 30]), 'inports', [], 'outports', []);
  state.blocks{end + 1, 1} = block;
  simulink_state(state);
  handle = -numel(state.blocks);
  set_param(path, varargin{:});
end
