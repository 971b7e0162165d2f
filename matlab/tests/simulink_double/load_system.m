function load_system(name)
  % Simulink's, as a double.
  assert(ischar(name));
end
