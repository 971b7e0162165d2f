function state = simulink_state(new)
  % What the double of Simulink knows: blocks, ports and lines of each model. It checks how the
  % scripts of this project use Simulink's functions, not how Simulink works.
  %
  %   simulink_state([])        forget all
  %   simulink_state('grouped') FMU blocks show a port a vector, not one a number
  persistent kept
  if isempty(kept) || (nargin > 0 && isempty(new))
    kept = struct('models', {{}}, 'blocks', {cell(0, 1)}, 'lines', zeros(0, 2), 'ports', 0, ...
                  'grouped', false);
  end
  if nargin > 0 && strcmp(new, 'grouped')
    kept.grouped = true;
  elseif nargin > 0 && ~isempty(new)
    kept = new;
  end
  state = kept;
end
