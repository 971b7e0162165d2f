function model = build_hold(design, eta_d, name)
  % Build the loop in Simulink: uuvsim.CosimBlock, the controller, To Workspace (MATLAB only).
  %
  %   build_hold(design, [0; 0; 1; 0; 0; 0]);  out = sim('hold');  plot(out.y)
  %
  % `uuvsim serve open.ssd --paused` must run meanwhile. The model is that of build_controller in a
  % closed loop with the co-simulation. It has not yet been run in MATLAB.
  if nargin < 3
    name = 'hold';
  end
  model = build_controller(design, name);
  ports = {'eta_d', 'nu_d', 'eta', 'nu'};
  for k = 1:4
    delete_line(model, [ports{k} '/1'], sprintf('law/%d', k));
    delete_block([model '/' ports{k}]);
  end
  delete_line(model, 'law/1', 'tau_d/1');
  delete_block([model '/tau_d']);

  names = design.names;
  add_block('simulink/User-Defined Functions/MATLAB System', [model '/cosim'], ...
            'System', 'uuvsim.CosimBlock', 'Position', [520, 100, 680, 200]);
  set_param([model '/cosim'], 'Inputs', ['''' names.input ''''], ...
            'Outputs', ['''' names.eta ', ' names.nu ''''], ...
            'SampleTime', sprintf('%.17g', design.dt));
  add_block('simulink/Signal Routing/Demux', [model '/parts'], 'Outputs', '[6 6]', ...
            'Position', [760, 110, 765, 190]);
  add_block('simulink/Sources/Constant', [model '/eta_d'], 'Value', mat2str(eta_d(:), 17), ...
            'Position', [60, 70, 160, 94]);
  add_block('simulink/Sources/Constant', [model '/nu_d'], 'Value', 'zeros(6, 1)', ...
            'Position', [60, 120, 160, 144]);
  add_block('simulink/Sinks/To Workspace', [model '/y'], 'VariableName', 'y', ...
            'SaveFormat', 'Timeseries', 'Position', [760, 230, 840, 254]);
  add_block('simulink/Sinks/To Workspace', [model '/tau'], 'VariableName', 'tau', ...
            'SaveFormat', 'Timeseries', 'Position', [520, 230, 600, 254]);
  wires = {'eta_d/1', 'law/1'; 'nu_d/1', 'law/2'; 'parts/1', 'law/3'; 'parts/2', 'law/4'; ...
           'law/1', 'cosim/1'; 'law/1', 'tau/1'; 'cosim/1', 'parts/1'; 'cosim/1', 'y/1'};
  for k = 1:size(wires, 1)
    add_line(model, wires{k, 1}, wires{k, 2}, 'autorouting', 'on');
  end
end
