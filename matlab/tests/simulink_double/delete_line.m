function delete_line(model, from, to)
  % Simulink's, as a double.
  state = simulink_state();
  ends = [port_of(state, model, from, 'outports'), port_of(state, model, to, 'inports')];
  there = find(all(state.lines == ends, 2));
  assert(numel(there) == 1, 'delete_line: %s to %s is not there', from, to);
  state.lines(there, :) = [];
  simulink_state(state);
end
