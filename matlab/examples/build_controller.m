function model = build_controller(design, name)
  % Build a Simulink model of the controller alone, for export as an FMU (MATLAB with Simulink):
  %
  %   build_controller(design, 'hold_controller');
  %   exportToFMU('hold_controller', 'FMIVersion', '2.0', 'FMUType', 'CS')
  %
  % Its ports are those that `uuvsim systems slot bluerov2_hold controller` prints. Written from
  % MathWorks' documentation and not yet run in MATLAB.
  if nargin < 2
    name = 'hold_controller';
  end
  if isempty(which('new_system'))
    error('uuvsim:matlab_only', 'uuvsim: Simulink is not installed; build_controller needs it.');
  end
  model = name;
  new_system(model);
  set_param(model, 'SolverType', 'Fixed-step', 'Solver', 'FixedStepDiscrete', ...
            'FixedStep', sprintf('%.17g', design.dt), 'StopTime', '60');
  law = [model '/law'];
  add_block('simulink/User-Defined Functions/MATLAB Function', law, ...
            'Position', [240, 60, 440, 260]);
  chart = find(get_param(model, 'Object'), '-isa', 'Stateflow.EMChart', 'Path', law);
  chart.Script = hold_code(design);
  inputs = {'eta_d', 'nu_d', 'eta', 'nu'};
  for k = 1:numel(inputs)
    top = 70 + 50 * (k - 1);
    add_block('simulink/Sources/In1', [model '/' inputs{k}], 'PortDimensions', '6', ...
              'OutDataTypeStr', 'double', 'SampleTime', sprintf('%.17g', design.dt), ...
              'Position', [80, top, 110, top + 14]);
    add_line(model, [inputs{k} '/1'], sprintf('law/%d', k), 'autorouting', 'on');
  end
  add_block('simulink/Sinks/Out1', [model '/tau_d'], 'Position', [540, 150, 570, 164]);
  add_line(model, 'law/1', 'tau_d/1', 'autorouting', 'on');
  open_system(model);
end
