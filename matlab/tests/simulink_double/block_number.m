function number = block_number(state, path)
  % Where a block of the double is kept, by its path or handle.
  if isnumeric(path)
    number = -path;
    return
  end
  paths = cellfun(@(block) block.path, state.blocks, 'UniformOutput', false);
  number = find(strcmp(path, paths));
  assert(numel(number) == 1, 'no block %s', path);
end
