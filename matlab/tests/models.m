function models(fmu2, fmu3, port)
  % Run the functions that build Simulink models against a double of Simulink, and CosimBlock
  % against a double of matlab.System: their calls are checked, not the reaction of Simulink.
  addpath(fullfile(fileparts(mfilename('fullpath')), 'simulink_double'));
  s = uuvsim.connect('port', port);
  s.reset();
  design = design_hold(s);
  s.close();

  checks = {
    'one FMU of FMI 2',           @() one_fmu(fmu2, '')
    'one FMU with vectors',       @() one_fmu(fmu2, 'grouped')
    'one FMU of FMI 3',           @() one_fmu(fmu3, '')
    'two FMUs, connected',        @() two_fmus(fmu2, '')
    'two FMUs with vectors',      @() two_fmus(fmu2, 'grouped')
    'wrong connections',          @() refusals(fmu2)
    'the controller alone',       @() controller(design)
    'the loop with the block',    @() loop(design)
    'the self test of Simulink',   @() assert(uuvsim.selftest_simulink(fmu2, port))
    'the block holds the station', @() block_holds(design, port)
  };
  for k = 1:size(checks, 1)
    simulink_state([]);
    try
      checks{k, 2}();
      printf('ok     %s\n', checks{k, 1});
    catch reason
      printf('FAILED %s: %s\n', checks{k, 1}, reason.message);
    end
  end
end

function one_fmu(file, how)
  simulink_state(how);
  part = uuvsim.read_fmu(file);
  model = uuvsim.build_simulink(file);
  state = simulink_state();
  assert(strcmp(model, 'uuvsim_model'));
  sim(model);
  inputs = part.inputs;
  if ~isempty(how)
    inputs = uuvsim.group_elements(inputs);
  end
  constants = cellfun(@(b) ~isempty(strfind(b.source, 'Constant')), state.blocks);
  assert(sum(constants) == numel(inputs));
end

function two_fmus(file, how)
  folder = tempname();
  mkdir(folder);
  second = fullfile(folder, 'second.fmu');
  copyfile(file, second);
  simulink_state(how);
  [~, first] = fileparts(file);
  uuvsim.build_simulink({file, second}, 'name', 'pair', 'step', 0.02, 'connect', ...
                        {[first '.tau_d'], 'second.eta_d'; 'second.tau_d', [first '.eta']});
  sim('pair');
  delete(second);
  rmdir(folder);
end

function refusals(file)
  [~, name] = fileparts(file);
  refused(@() uuvsim.build_simulink(file, 'name', 'a', 'connect', {[name '.x'], 'y'}), 'tau_d');
  refused(@() uuvsim.build_simulink(file, 'name', 'a'), 'is open');
  refused(@() uuvsim.build_simulink(file, 'nme', 'b'), 'name');
  refused(@() uuvsim.build_simulink('nowhere.fmu', 'name', 'c'), 'nowhere.fmu');
end

function controller(design)
  assert(strcmp(build_controller(design), 'hold_controller'));
  sim('hold_controller');
end

function loop(design)
  assert(strcmp(build_hold(design, [0; 0; 1; 0; 0; 0]), 'hold'));
  sim('hold');
end

function block_holds(design, port)
  source = fileread(fullfile(fileparts(which('lqr_gain')), '..', '+uuvsim', 'CosimBlock.m'));
  source = strrep(strrep(source, 'matlab.System', 'SystemDouble'), ' (Nontunable)', '');
  source = strrep(strrep(source, '(Static, Access = protected)', '(Static)'), ...
                  '(Access = protected)', '');
  source = strrep(source, 'classdef CosimBlock', 'classdef CosimBlockDouble');
  folder = tempname();
  mkdir(folder);
  file = fopen(fullfile(folder, 'CosimBlockDouble.m'), 'w');
  fputs(file, source);
  fclose(file);
  addpath(folder);
  block = CosimBlockDouble();
  block.Port = port;
  block.SampleTime = design.dt;
  block.Start = {'hull.v_c', [0.3, 0.2, 0]};
  block.Inputs = '''allocation.tau_d''';  % with quotes, as some dialogs would give it
  assert(isequal(block.sizes(), [12, 1]));
  block.start();
  memory = zeros(12, 1);
  for k = 1:100
    y = block.output();
    [u, memory] = hold_law(design, memory, y(1:6), y(7:12), [0; 0; 1; 0; 0; 0]);
    block.update(u);
  end
  last = block.output();
  block.finish();

  s = uuvsim.connect('port', port);
  s.reset();
  s.set('hull.v_c', [0.3, 0.2, 0]);
  r = hold_station(s, design, [0; 0; 1; 0; 0; 0], 10);
  s.close();
  assert(isequal(r.eta(end, :).', last(1:6)), 'it differs from hold_station by %g', ...
         max(abs(r.eta(end, :).' - last(1:6))));
  clear('block');
  rmpath(folder);
  delete(fullfile(folder, 'CosimBlockDouble.m'));
  rmdir(folder);
end

function refused(call, words)
  try
    call();
  catch reason
    assert(~isempty(strfind(reason.message, words)), ...
           '"%s" is not in: %s', words, reason.message);
    return
  end
  error('models:refused', 'it was not refused (expected: %s)', words);
end
