classdef Transport < handle
  % One connection to a co-simulation: frames of a JSON header and float64 numbers.
  % Only this file uses sockets, which differ between MATLAB and Octave.
  properties (SetAccess = private)
    host = '';
    port = 0;
    greeting = struct();
  end
  properties (Access = private)
    socket = [];
    timeout = 10;
    pending = false;  % a request has been sent whose answer has not been read
    direct = false;  % Octave's package has functions under its slow read and write
  end

  methods
    function self = Transport(host, port, timeout)
      self.host = host;
      self.port = port;
      self.timeout = timeout;
      self.socket = connected(host, port, timeout);
      self.direct = exist('OCTAVE_VERSION', 'builtin') ~= 0 ...
                    && exist('__tcpclient_read__') == 3 && exist('__tcpclient_write__') == 3;
      self.greeting = self.receive();
    end

    function [header, numbers] = request(self, header, numbers, patience)
      % Send a header (a struct) and numbers, and wait for the answer at most `patience` seconds.
      self.check_in_step();
      self.send(unicode2native(jsonencode(header), 'UTF-8'), numbers);
      if nargin > 3
        set_timeout(self.socket, patience);
        restore = onCleanup(@() set_timeout(self.socket, self.timeout));
      end
      [header, numbers] = self.receive();
    end

    function numbers = exchange(self, numbers)
      % Make a compact step: send and receive the numbers that the layout defines.
      if isempty(self.socket)
        self.gone();
      end
      self.check_in_step();
      self.pending = true;
      data = [typecast(uint32([0, 8 * numel(numbers)]), 'uint8'), typecast(numbers(:).', 'uint8')];
      try
        if self.direct  % 0.4 ms less than read and write; by feval, for MATLAB has no such names
          patience = 1000 * self.timeout;
          feval('__tcpclient_write__', self.socket, data);
          sizes = double(typecast(feval('__tcpclient_read__', self.socket, 8, patience), 'uint32'));
        else
          write(self.socket, data);
          sizes = double(typecast(uint8(read(self.socket, 8)), 'uint32'));
        end
        if sizes(1) == 0
          if self.direct
            body = feval('__tcpclient_read__', self.socket, sizes(2), patience);
          else
            body = uint8(read(self.socket, sizes(2)));
          end
          numbers = typecast(body, 'double');
          self.pending = false;
          if numel(numbers) == sizes(2) / 8
            return
          end
        end
      catch reason
        self.lost(reason.message);
      end
      if sizes(1) == 0
        self.lost();
      end
      self.rest(sizes);  % a header is an error, and is raised
      error('uuvsim:protocol', 'uuvsim: a header arrived instead of a compact step; reconnect.');
    end

    function close(self)
      self.socket = [];  % the last reference: MATLAB and Octave close it
    end

    function open = isopen(self)
      open = ~isempty(self.socket);
    end
  end

  methods (Access = private)
    function send(self, head, numbers)
      if isempty(self.socket)
        self.gone();
      end
      body = typecast(reshape(double(numbers), 1, []), 'uint8');
      sizes = typecast(uint32([numel(head), numel(body)]), 'uint8');
      self.pending = true;
      try
        write(self.socket, [sizes, reshape(uint8(head), 1, []), body]);
      catch reason
        self.lost(reason.message);
      end
    end

    function [header, numbers] = receive(self)
      prefix = self.take(8);
      [header, numbers] = self.rest(double(typecast(prefix, 'uint32')));
    end

    function [header, numbers] = rest(self, sizes)
      header = struct();
      if sizes(1) > 0
        header = jsondecode(native2unicode(self.take(sizes(1)), 'UTF-8'));
      end
      numbers = typecast(self.take(sizes(2)), 'double');
      self.pending = false;
      if isfield(header, 'ok') && ~header.ok
        error(['uuvsim:' header.kind], '%s', ['uuvsim: ' header.error]);
      end
    end

    function data = take(self, count)
      data = zeros(1, 0, 'uint8');
      if count == 0
        return
      end
      try
        data = reshape(uint8(read(self.socket, count)), 1, []);
      catch reason
        self.lost(reason.message);
      end
      if numel(data) < count
        self.lost();
      end
    end

    function check_in_step(self)
      % After Ctrl-C, the answer to the previous call would be read as the answer to this one.
      if self.pending && ~isempty(self.socket)
        self.socket = [];
        error('uuvsim:interrupted', ...
              ['uuvsim: a call before this one was interrupted, and its answer never read; ' ...
               'call s = uuvsim.connect() for another connection.']);
      end
    end

    function gone(self)
      error('uuvsim:closed', ...
            'uuvsim: this connection is closed; call s = uuvsim.connect() for another.');
    end

    function lost(self, reason)
      self.socket = [];
      why = '';
      if nargin > 1
        why = [' (' strtrim(reason) ')'];
      end
      error('uuvsim:disconnected', ...
            ['uuvsim: no answer from %s, port %d%s. The co-simulation has ended or is busy for ' ...
             'longer than the timeout: look at the window where `uuvsim serve` runs, then call ' ...
             's = uuvsim.connect() again (its ''timeout'' is in seconds).'], ...
            self.host, self.port, why);
    end
  end
end

function socket = connected(host, port, timeout)
  in_octave = exist('OCTAVE_VERSION', 'builtin') ~= 0;
  try
    if in_octave
      load_instrument_control();
      socket = tcpclient(host, port, 'Timeout', timeout);
    else
      socket = in_matlab(host, port, timeout);
    end
  catch reason
    if strncmp(reason.identifier, 'uuvsim:', 7)
      rethrow(reason);
    end
    error('uuvsim:unreachable', ...
          ['uuvsim: nothing answers at %s, port %d (%s). Start a co-simulation there, in a ' ...
           'terminal:\n\n    uuvsim serve bluerov2_hold --paused\n\nor name its address: ' ...
           'uuvsim.connect(''host'', ''127.0.0.1'', ''port'', 7448).'], ...
          host, port, strtrim(reason.message));
  end
end

function socket = in_matlab(host, port, timeout)
  try  % Nagle's algorithm off, where this release knows the option
    socket = tcpclient(host, port, 'Timeout', timeout, 'EnableTransferDelay', false);
  catch reason
    if isempty(strfind(reason.message, 'EnableTransferDelay'))
      rethrow(reason);
    end
    socket = tcpclient(host, port, 'Timeout', timeout);
  end
end

function load_instrument_control()
  if exist('tcpclient') == 0
    try
      pkg('load', 'instrument-control');
    catch
      error('uuvsim:package', ...
            ['uuvsim: Octave needs its package instrument-control. On Debian and Ubuntu: ' ...
             'sudo apt-get install octave-instrument-control; elsewhere, in Octave: ' ...
             'pkg install -forge instrument-control']);
    end
  end
end

function set_timeout(socket, seconds)
  if ~isempty(socket)
    if exist('OCTAVE_VERSION', 'builtin') ~= 0
      set(socket, 'Timeout', seconds);
    else
      socket.Timeout = seconds;
    end
  end
end
