function set_param(path, varargin)
  % Simulink's, as a double: values are texts, but for positions.
  state = simulink_state();
  if any(strcmp(path, state.models))
    known = {'SolverType', 'Solver', 'FixedStep', 'StopTime'};
    for k = 1:2:numel(varargin)
      assert(any(strcmp(varargin{k}, known)), 'set_param: %s of a model', varargin{k});
      assert(ischar(varargin{k + 1}));
    end
    return
  end
  number = block_number(state, path);
  block = state.blocks{number};
  for k = 1:2:numel(varargin)
    name = varargin{k};
    value = varargin{k + 1};
    assert(any(strcmp(name, [block.known, {'Position', 'Script'}])), 'set_param: %s of %s', ...
           name, block.source);
    assert(strcmp(name, 'Position') && isequal(size(value), [1, 4]) || ischar(value));
    block.parameters.(name) = value;
  end
  [in, out] = counts(block, state.grouped);
  total = state.ports;
  block.inports = total + (1:in);
  block.outports = total + in + (1:out);
  state.ports = total + in + out;
  state.blocks{number} = block;
  simulink_state(state);
end

function [in, out] = counts(block, grouped)
  switch block.source(find(block.source == '/', 1, 'last') + 1:end)
    case 'FMU'
      part = uuvsim.read_fmu(block.parameters.FMUName);
      if grouped
        part.inputs = uuvsim.group_elements(part.inputs);
        part.outputs = uuvsim.group_elements(part.outputs);
      end
      in = numel(part.inputs);
      out = numel(part.outputs);
    case {'Constant', 'In1'}
      [in, out] = deal(0, 1);
    case {'Out1', 'To Workspace'}
      [in, out] = deal(1, 0);
    case 'Demux'
      [in, out] = deal(1, 1);
      if isfield(block.parameters, 'Outputs')
        out = numel(str2num(block.parameters.Outputs));
      end
    case 'MATLAB Function'
      [in, out] = deal(1, 1);
      if isfield(block.parameters, 'Script')
        head = regexp(block.parameters.Script, '\(([^)]*)\)', 'tokens', 'once');
        in = numel(strsplit(head{1}, ','));
      end
    otherwise
      [in, out] = deal(1, 1);
  end
end
