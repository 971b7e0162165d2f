function passed = selftest_simulink(fmu, port)
  % Test the parts that need Simulink, and print a report to send in (MATLAB with Simulink only):
  %
  %   uuvsim fmu client bluerov2_hold             (in a terminal; and then:)
  %   uuvsim serve bluerov2_hold --paused
  %   uuvsim.selftest_simulink('bluerov2_hold_client.fmu')
  %
  % Builds a model around the FMU and simulates one second, then a model around uuvsim.CosimBlock,
  % which sets the current and reads the position of the hull.
  if nargin < 2
    port = 7448;
  end
  fprintf('uuvsim.selftest_simulink\n  %s\n', version());
  checks = {
    'the ports of the FMU are read',        @() reads(fmu)
    'a model of the FMU is built',          @() uuvsim.build_simulink(fmu, 'name', 'uuvsim_st', ...
                                                                      'stop', 1)
    'it runs for a second',                 @() sim('uuvsim_st')
    'a model of the block is built',        @() block_model(port)
    'it runs for a second, and reads',      @() sim('uuvsim_st_block')
  };
  passed = true;
  for k = 1:size(checks, 1)
    try
      checks{k, 2}();
      fprintf('  ok     %s\n', checks{k, 1});
    catch reason
      passed = false;
      fprintf('  FAILED %s: %s\n', checks{k, 1}, reason.message);
    end
  end
end

function reads(fmu)
  part = uuvsim.read_fmu(fmu);
  fprintf('         FMI %s, %d inputs, %d outputs, step %g s\n', part.version, ...
          numel(part.inputs), numel(part.outputs), part.step);
end

function block_model(port)
  model = 'uuvsim_st_block';
  new_system(model);
  set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', ...
            'FixedStep', '0.1', 'StopTime', '1');
  add_block('simulink/User-Defined Functions/MATLAB System', [model '/cosim'], ...
            'System', 'uuvsim.CosimBlock');
  set_param([model '/cosim'], 'Inputs', '''hull.v_c''', 'Outputs', '''hull.eta''', ...
            'SampleTime', '0.1', 'Port', sprintf('%d', port));
  add_block('simulink/Sources/Constant', [model '/v_c'], 'Value', '[0.3; 0; 0]');
  add_block('simulink/Sinks/To Workspace', [model '/eta'], 'VariableName', 'eta', ...
            'SaveFormat', 'Timeseries');
  add_line(model, 'v_c/1', 'cosim/1', 'autorouting', 'on');
  add_line(model, 'cosim/1', 'eta/1', 'autorouting', 'on');
end
