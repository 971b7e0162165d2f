function file = build_zenoh(zenoh_pico, target)
  % Compile the MEX client on Zenoh, with a zenoh-pico that you have built and installed:
  %
  %   build_zenoh('/path/where/zenoh-pico/is/installed')
  %
  % It needs include/zenoh-pico.h and lib/libzenohpico.a there, and a C compiler that `mex` knows
  % (in Octave: mkoctfile and gcc). Returns the file; `target` is its folder, by default this one.
  here = fileparts(mfilename('fullpath'));
  if nargin < 2
    target = here;
  end
  header = fullfile(zenoh_pico, 'include', 'zenoh-pico.h');
  library = '';
  for name = {'libzenohpico.a', 'zenohpico.lib', 'zenohpico_static.lib'}
    if exist(fullfile(zenoh_pico, 'lib', name{1}), 'file') == 2
      library = fullfile(zenoh_pico, 'lib', name{1});
    end
  end
  if exist(header, 'file') ~= 2 || isempty(library)
    error('uuvsim:zenoh', ['uuvsim: %s: include/zenoh-pico.h and lib/libzenohpico.a are ' ...
          'expected there; docs/connections/connect_matlab.md says how they are built.'], ...
          zenoh_pico);
  end
  if ispc()
    platform = '-DZENOH_WINDOWS';
  elseif ismac()
    platform = '-DZENOH_MACOS';
  else
    platform = '-DZENOH_LINUX';
  end
  arguments = {platform, ['-I' fullfile(zenoh_pico, 'include')], ...
               fullfile(here, 'uuvsim_zenoh.c'), library};
  if ispc()
    arguments = [arguments, {'-lws2_32', '-liphlpapi'}];
  end
  file = fullfile(target, ['uuvsim_zenoh.' mexext()]);
  if exist('OCTAVE_VERSION', 'builtin') ~= 0
    [said, status] = mkoctfile('--mex', '-Wall', '-o', file, arguments{:});
    if status ~= 0
      error('uuvsim:zenoh', 'uuvsim: mkoctfile: %s', said);
    end
  else
    mex('-outdir', target, arguments{:});
  end
end
