// Runs a system in node, after system.js and timeline.js: `task.json` of a folder says what; `rows.bin` is the result.
(function () {
  const { readFileSync, writeFileSync } = require("fs"), folder = process.argv[1];
  const task = JSON.parse(readFileSync(folder + "/task.json", "utf8"));
  const bytes = readFileSync(task.module), system = new System(task.table, bytes), line = new Timeline(system);
  const start = Object.entries(task.start).flatMap(([name, values]) => values.map((value, k) => [name, k, value]));
  line.every = Infinity;
  const refused = line.load({ seed: task.seed, start, events: task.events });
  if (refused.length) throw new Error(refused[0]);
  const rows = new Float64Array(task.record ? (task.steps + 1) * system.columns.length : 0);
  line.observe = () => rows.set(system.outputs(), system.steps * system.columns.length);
  if (task.record) { line.every = 1; line.observe(); }
  const before = process.cpuUsage().user;
  if (task.record || task.events.length) line.advance(task.steps); else system.run(task.steps);
  const seconds = (process.cpuUsage().user - before) / 1e6;
  writeFileSync(folder + "/rows.bin", Buffer.from(rows.buffer, 0, 8 * (task.record ? (system.steps + 1) * system.columns.length : 0)));
  const imports = WebAssembly.Module.imports(new WebAssembly.Module(bytes)).map(i => i.name);
  console.log(JSON.stringify({ hash: system.hash, steps: system.steps, failure: line.failure, seconds, imports }));
})();
