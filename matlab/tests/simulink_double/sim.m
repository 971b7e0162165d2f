function out = sim(name)
  % Simulink's, as a double: the model is there, and each input of its blocks has a line.
  state = simulink_state();
  assert(any(strcmp(name, state.models)), 'sim: no model %s', name);
  for k = 1:numel(state.blocks)
    block = state.blocks{k};
    for port = block.inports
      assert(any(state.lines(:, 2) == port), '%s: an input has no line', block.path);
    end
  end
  out = struct();
end
