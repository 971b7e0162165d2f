function yes = bdIsLoaded(name)
  % Simulink's, as a double.
  state = simulink_state();
  yes = any(strcmp(name, state.models));
end
