function open_system(name)
  % Simulink's, as a double.
  assert(ischar(name));
end
