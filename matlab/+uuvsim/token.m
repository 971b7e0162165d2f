function token = token(host, port)
  % Return the token of a server of the same user on this machine, or '' if there is none.
  %
  % `uuvsim serve` writes it to a file that only its user can read, and uuvsim.connect() calls this
  % function. The folder of the files is UUVSIM_TOKENS if that is set; the token for a server
  % elsewhere is UUVSIM_TOKEN.
  token = '';
  if any(strcmp(host, {'localhost', '::1'})) || strncmp(host, '127.', 4)
    file = fullfile(folder_of_tokens(), sprintf('%d@%s', port, lower(machine())));
    if exist(file, 'file') == 2
      refuse_others(file);
      token = strtrim(fileread(file));
    end
  end
  if isempty(token)
    token = getenv('UUVSIM_TOKEN');
  end
end

function folder = folder_of_tokens()
  folder = getenv('UUVSIM_TOKENS');
  if ~isempty(folder)
    return
  end
  if ispc()
    base = getenv('LOCALAPPDATA');
  elseif ismac()
    base = fullfile(getenv('HOME'), 'Library', 'Application Support');
  else
    base = getenv('XDG_STATE_HOME');
    if isempty(base)
      base = fullfile(getenv('HOME'), '.local', 'state');
    end
  end
  folder = fullfile(base, 'uuvsim-cosim', 'tokens');
end

function name = machine()
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    name = gethostname();
  else
    [~, name] = system('hostname');
    name = strtrim(name);
  end
end

function refuse_others(file)
  % MATLAB returns the mode of a file but not its owner; Octave returns both. Windows has no mode.
  if ispc()
    return
  end
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    found = lstat(file);
    mode = found.modestr;
    mine = mode(1) == '-' && strcmp(mode(5:10), '------') && found.uid == geteuid();
  else
    [~, found] = fileattrib(file);
    others = [found.GroupRead, found.GroupWrite, found.OtherRead, found.OtherWrite];
    mine = ~any(others == 1);
  end
  if ~mine
    error('uuvsim:token', ['uuvsim: %s: others may have read or written it; expected a file of ' ...
          'your own with mode 600. End the server and start it again.'], file);
  end
end
