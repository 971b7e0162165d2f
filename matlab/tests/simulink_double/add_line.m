function add_line(model, from, to, varargin)
  % Simulink's, as a double: an input takes one line, and both ends are there.
  state = simulink_state();
  assert(isequal(varargin, {'autorouting', 'on'}) && any(strcmp(model, state.models)));
  from = port_of(state, model, from, 'outports');
  to = port_of(state, model, to, 'inports');
  assert(~any(state.lines(:, 2) == to), 'add_line: that input has a line');
  state.lines(end + 1, :) = [from, to];
  simulink_state(state);
end
