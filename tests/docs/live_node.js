// Computes the live responses of components in node, from the files of their pages: `task.json` of a
// folder says which, and `result.json` has what was found.
(async function () {
  const fs = require("fs"), folder = process.argv[1], task = JSON.parse(fs.readFileSync(folder + "/task.json", "utf8"));
  (0, eval)(fs.readFileSync(folder + "/live.js", "utf8"));
  const found = {};
  for (const { name, set } of task) {
    (0, eval)(fs.readFileSync(`${folder}/${name}.js`, "utf8"));
    const data = uuvsimLive.data[name], response = await uuvsimLive.StepResponse.of(data);
    const first = response.compute(), again = response.compute(), changed = new Set();
    response.after.clear();
    const calm = response.compute();
    response.after = new Map(Object.entries(data.after));
    const columns = data.table.output.flatMap(row => Array(row.size).fill(row.name));
    first.rows.forEach((row, i) => row.forEach((x, j) => { if (x !== (i ? calm.rows[i][j] : x)) changed.add(columns[j]); }));
    const moving = new Set();
    first.rows.forEach(row => row.forEach((x, j) => { if (x !== first.rows[0][j]) moving.add(columns[j]); }));
    const refused = Object.entries(set || {}).map(([n, x]) => response.system.set(n, 0, x)).join("");
    const other = response.compute();
    found[name] = { hash: first.hash, again: again.hash, failure: first.failure, changed: [...changed],
      moving: [...moving], refused, other: other.hash, last: first.rows[first.rows.length - 1], steps: response.system.steps, points: first.rows.length };
  }
  fs.writeFileSync(folder + "/result.json", JSON.stringify(found));
})().catch(error => { console.error(error); process.exit(1); });
