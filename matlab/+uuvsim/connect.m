function session = connect(varargin)
  % Connect to a running co-simulation:  s = uuvsim.connect()
  %
  % Start one in a terminal first:  uuvsim serve bluerov2_hold --paused
  % Options, as name and value, in MATLAB also as uuvsim.connect(port=7448):
  %   'host'      '127.0.0.1'
  %   'port'      7448
  %   'timeout'   longest time to wait for an answer [s], 10
  %   'name'      name of this client for others, 'matlab' or 'octave'
  %   'lockstep'  true: others wait for this client's steps, and it for theirs; false
  %   'lag'       longest time that others wait for it in lockstep [s], 5
  %   'user', 'password'   if the server asks for them
  %   'token'     of a server of another user or on another machine; else it is found
  %
  % See also uuvsim.Session, uuvsim.selftest, uuvsim.linearize.
  name = 'matlab';
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    name = 'octave';
  end
  options = struct('host', '127.0.0.1', 'port', 7448, 'timeout', 10, 'name', name, ...
                   'lockstep', false, 'lag', 5, 'user', '', 'password', '', 'token', '');
  options = uuvsim.options_of(options, varargin, 'uuvsim.connect');
  for number = {'port', 'timeout', 'lag'}
    if ~isnumeric(options.(number{1})) || ~isscalar(options.(number{1}))
      error('uuvsim:option', 'uuvsim: %s is a number.', number{1});
    end
  end
  flag = options.lockstep;
  if ~isscalar(flag) || ~(islogical(flag) || (isnumeric(flag) && any(flag == [0 1])))
    error('uuvsim:option', 'uuvsim: lockstep is true or false.');
  end
  session = uuvsim.Session(options);
end
