function value = get_param(path, name)
  % Simulink's, as a double.
  state = simulink_state();
  if strcmp(name, 'Object')
    assert(any(strcmp(path, state.models)));
    value = SimulinkObject(path);
    return
  end
  block = state.blocks{block_number(state, path)};
  switch name
    case 'PortHandles'
      value = struct('Inport', block.inports, 'Outport', block.outports);
    otherwise
      value = block.parameters.(name);
  end
end
