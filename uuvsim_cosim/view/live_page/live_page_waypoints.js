// Waypoints of the guidance, seen from above: a click adds one, a drag moves one, the table has the numbers.
function waypointsCard(page, names) {
  const { find, make, line, shown, notice } = page, { table, count, eta } = names;
  const svg = find("#plan"), rows = find("#points"), NS = svg.namespaceURI;
  const most = line.system.rows.get(table).shape[0];
  const number = () => count ? line.value(count, 0) : most;
  const points = () => Array.from({ length: number() }, (_, k) => [0, 1, 2].map(i => line.value(table, 3 * k + i)));
  // Write the waypoints from the present point on.
  function write(next) {
    if (!next.length || next.length > most) { notice(`The guidance needs 1 to ${most} waypoints.`); return; }
    const refused = line.together(() => {
      const found = next.flatMap((p, k) => p.map((v, i) => v === line.value(table, 3 * k + i) ? "" : line.set(table, 3 * k + i, v)));
      if (count && next.length !== number()) found.push(line.set(count, 0, next.length));
      return found.find(Boolean) || "";
    });
    notice(refused);
    page.refresh();
  }
  // ---- the plan: north is up; its scale changes only when the waypoints do ----
  const size = [420, 320];
  let scale = 1, middle = [0, 0], held = null, drawn = "";
  const x = p => size[0] / 2 + (p[1] - middle[1]) * scale, y = p => size[1] / 2 - (p[0] - middle[0]) * scale;
  function place(e) {
    const box = svg.getBoundingClientRect(), k = Math.max(size[0] / box.width, size[1] / box.height);
    const px = [(e.clientX - box.left - box.width / 2) * k, (e.clientY - box.top - box.height / 2) * k];
    const digit = 10 ** Math.max(0, Math.ceil(Math.log10(scale)) - 1);
    return [-px[1] / scale + middle[0], px[0] / scale + middle[1]].map(v => Math.round(v * digit) / digit + 0);
  }
  function fit() {
    const all = [...points(), [...eta.map(at => line.system.values[at])]], low = [0, 1].map(i => Math.min(...all.map(p => p[i]))), high = [0, 1].map(i => Math.max(...all.map(p => p[i])));
    middle = [0, 1].map(i => (low[i] + high[i]) / 2);
    scale = Math.min(0.8 * size[1] / Math.max(high[0] - low[0], 4), 0.8 * size[0] / Math.max(high[1] - low[1], 4));
  }
  const shape = (tag, more) => { const e = document.createElementNS(NS, tag); for (const [k, v] of Object.entries(more)) e.setAttribute(k, v); return e; };
  const track = shape("polyline", { class: "line truth" }), vessel = shape("path", { class: "vessel", d: page.data.vessel });
  const path = shape("polyline", { class: "line desired dash" }), marks = shape("g", {}), lines = shape("g", { class: "grid" });
  svg.setAttribute("viewBox", `0 0 ${size[0]} ${size[1]}`);
  svg.append(lines, path, track, marks, vessel);
  function grid() {
    const spread = 80 / scale, power = 10 ** Math.floor(Math.log10(spread)), every = [1, 2, 5, 10].map(m => m * power).find(v => v >= spread);
    lines.replaceChildren();
    for (const i of [0, 1]) {
      const reach = size[1 - i] / 2 / scale;
      for (let v = Math.ceil((middle[i] - reach) / every) * every; v < middle[i] + reach; v += every) {
        const p = i ? [0, v] : [v, 0], at = i ? x(p) : y(p);
        lines.append(shape("line", i ? { x1: at, x2: at, y1: 0, y2: size[1] } : { x1: 0, x2: size[0], y1: at, y2: at }));
        const label = shape("text", i ? { x: at + 3, y: size[1] - 4 } : { x: 4, y: at - 3 });
        label.textContent = `${i ? "E" : "N"} ${shown(+v.toPrecision(6))}`;
        lines.append(label);
      }
    }
  }
  function sync() {
    const now = points(), text = JSON.stringify(now);
    if (text === drawn && !held) return;
    drawn = text;
    if (!held) fit();
    grid();
    const seen = held ? held.points : now;
    path.setAttribute("points", seen.map(p => `${x(p)},${y(p)}`).join(" "));
    marks.replaceChildren(...seen.flatMap((p, k) => {
      const mark = shape("circle", { class: "waypoint", cx: x(p), cy: y(p), r: 7, "data-number": k }), label = shape("text", { x: x(p) + 9, y: y(p) - 7, class: "label" });
      label.textContent = k + 1;
      return [mark, label];
    }));
    rows.replaceChildren(...now.map((p, k) => make("div", { className: "row point" }, make("span", { textContent: k + 1 }), ...["N", "E", "D"].map((axis, i) => {
      const field = make("input", { type: "number", step: "any", value: p[i] });
      field.setAttribute("aria-label", `waypoint ${k + 1}: ${axis} [m]`);
      field.onchange = () => write(points().map((q, j) => j === k ? q.map((v, d) => d === i ? (field.value === "" ? NaN : +field.value) : v) : q));
      return field;
    }), make("button", { type: "button", textContent: "×", title: `remove waypoint ${k + 1}`, onclick: () => write(points().filter((_, j) => j !== k)) }))));
    if (window.uuvsimScene && window.uuvsimScene.path) window.uuvsimScene.path(0, seen);
    move();
  }
  function move() {
    const [n, e, , , , psi] = eta.map(at => line.system.values[at]);
    vessel.setAttribute("transform", `translate(${x([n, e])} ${y([n, e])}) rotate(${psi * 180 / Math.PI - 90}) scale(1.3)`);
    const seen = page.track(), step = Math.max(1, Math.ceil(seen[0].length / 400));
    track.setAttribute("points", Array.from({ length: Math.ceil(seen[0].length / step) }, (_, k) => { const p = [seen[0][k * step], seen[1][k * step]]; return `${x(p)},${y(p)}`; }).join(" "));
  }
  svg.onpointerdown = e => {
    const now = points(), k = e.target.dataset && e.target.dataset.number;
    if (e.button) return;
    if (k === undefined && now.length >= most) { notice(`The guidance has room for ${most} waypoints.`); return; }
    const [north, east] = place(e), index = k === undefined ? now.push([north, east, now.at(-1)[2]]) - 1 : +k;
    held = { index, points: now };
    svg.setPointerCapture(e.pointerId);
    sync();
  };
  svg.onpointermove = e => {
    if (!held) return;
    held.points[held.index] = [...place(e), held.points[held.index][2]];
    sync();
  };
  svg.onpointerup = () => { if (held) { const { points: next } = held; held = null; drawn = ""; write(next); sync(); } };
  svg.onpointercancel = () => { held = null; drawn = ""; sync(); };
  return { sync, move };
}
