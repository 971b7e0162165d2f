function new_system(name)
  % Simulink's, as a double.
  state = simulink_state();
  assert(isvarname(name), 'new_system: %s is no name', name);
  assert(~any(strcmp(name, state.models)), 'new_system: %s is there', name);
  state.models{end + 1} = name;
  simulink_state(state);
end
