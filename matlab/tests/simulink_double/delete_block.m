function delete_block(path)
  % Simulink's, as a double.
  state = simulink_state();
  state.blocks(block_number(state, path)) = [];
  simulink_state(state);
end
