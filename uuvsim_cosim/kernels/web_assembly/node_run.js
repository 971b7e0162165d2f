// Runs a system in node, after system.js: `task.json` of a folder says what; `rows.bin` is the result.
(function () {
  const { readFileSync, writeFileSync } = require("fs"), folder = process.argv[1];
  const task = JSON.parse(readFileSync(folder + "/task.json", "utf8"));
  const bytes = readFileSync(task.module), system = new System(task.table, bytes);
  system.seed = task.seed;
  for (const [name, values] of Object.entries(task.start)) values.forEach((value, k) => {
    const refused = system.set(name, k, value);
    if (refused) throw new Error(refused);
  });
  system.begin();
  const rows = task.record ? new Float64Array((task.steps + 1) * system.columns.length) : new Float64Array(0);
  const keep = () => { if (task.record) rows.set(system.outputs(), system.steps * system.columns.length); };
  keep();
  const before = process.cpuUsage().user;
  if (!task.record) system.run(task.steps);
  else while (system.steps < task.steps && !system.failure) { system.run(1); keep(); }
  const seconds = (process.cpuUsage().user - before) / 1e6;
  writeFileSync(folder + "/rows.bin", Buffer.from(rows.buffer, 0, 8 * (task.record ? (system.steps + 1) * system.columns.length : 0)));
  const imports = WebAssembly.Module.imports(new WebAssembly.Module(bytes)).map(i => i.name);
  console.log(JSON.stringify({ hash: system.hash, steps: system.steps, failure: system.failure, seconds, imports }));
})();
