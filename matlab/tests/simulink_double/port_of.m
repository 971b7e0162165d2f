function handle = port_of(state, model, port, kind)
  % The number of a port of the double, by number or as 'block/1'.
  if isnumeric(port)
    all_ports = cellfun(@(block) block.(kind), state.blocks, 'UniformOutput', false);
    assert(any([all_ports{:}] == port), 'no port %g among %s', port, kind);
    handle = port;
    return
  end
  parts = strsplit(port, '/');
  block = state.blocks{block_number(state, [model '/' parts{1}])};
  number = str2double(parts{2});
  assert(number <= numel(block.(kind)), '%s: it has %d', port, numel(block.(kind)));
  handle = block.(kind)(number);
end
