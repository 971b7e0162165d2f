// The page of a system that runs in the browser: controls, parameters, plots, and the scene's motion.
(async function () {
  const find = selector => document.querySelector(selector), root = document.documentElement;
  const data = JSON.parse(find("#data").textContent);
  const notice = text => { find("#notice").textContent = text; };
  const make = (tag, more, ...inside) => { const e = Object.assign(document.createElement(tag), more); e.append(...inside); return e; };
  const shown = value => String(+value.toPrecision(6)).replace("-", "−");

  // ---- the system ----
  async function unpacked(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    return new Response(stream).arrayBuffer();
  }
  let system;
  try {
    system = new System(data.table, await unpacked(data.module));
  } catch (error) {
    const missing = typeof WebAssembly !== "object" ? "WebAssembly" : typeof DecompressionStream !== "function" ? "DecompressionStream" : "";
    notice(missing ? `This browser has no ${missing}, or it is switched off, so that the system cannot run here. Browsers since 2023 have it.`
      : `The system cannot start: ${error.message}`);
    document.querySelectorAll(".drive button, .drive select").forEach(e => { e.disabled = true; });
    return;
  }

  // ---- history of all outputs: equal distances in time; every second point goes when it is full ----
  const POINTS = 4000, columns = system.columns.length;
  const times = new Float64Array(POINTS), history = Array.from({ length: columns }, () => new Float64Array(POINTS));
  let filled = 0, every = 1;
  function keep() {
    if (filled === POINTS) {
      for (const list of [times, ...history]) for (let k = 0; 2 * k < POINTS; k++) list[k] = list[2 * k];
      filled = POINTS / 2; every *= 2;
      if (system.steps % every) return;
    }
    const values = system.values;
    times[filled] = system.time;
    for (let j = 0; j < columns; j++) history[j][filled] = values[system.columns[j]];
    filled++;
    moveScene();
  }
  function advance(n) {
    while (n > 0) {
      const piece = Math.min(n, every - system.steps % every), made = system.run(piece);
      if (system.steps % every === 0) keep();
      if (made < piece || system.failure) { pause(); notice(system.failure + "."); return false; }
      n -= piece;
    }
    return true;
  }

  // ---- run, pause, step ----
  const SLICE = 14;  // ms of a frame for computing
  let running = false, last = 0, owed = 0, began = [0, 0];
  function pause() { running = false; find("#run").textContent = "run"; find("#rate").textContent = ""; }
  function run() {
    if (system.failure) return;
    notice(""); running = true; last = performance.now(); owed = 0; began = [last, system.time];
    find("#run").textContent = "pause"; requestAnimationFrame(frame);
  }
  function frame(now) {
    if (!running) return;
    const speed = +find("#speed").value, until = performance.now() + SLICE;
    owed = Math.min(owed + (now - last) / 1000 * speed / system.tick, 1e9); last = now;
    let part = Math.max(1, Math.min(64, every));
    while (owed >= 1 && performance.now() < until) {
      const n = Math.min(Math.floor(owed), part);
      if (!advance(n)) break;
      owed -= n; part *= 2;
      if (part > 4096) part = 4096;
    }
    if (owed > speed / system.tick) owed = 0;  // the machine is too slow for this speed
    draw(now);
    requestAnimationFrame(frame);
  }
  function restart() {
    system.begin(); filled = 0; every = 1; owed = 0; began = [performance.now(), 0]; keep();
    if (window.uuvsimScene) window.uuvsimScene.clear();
    notice(system.failure && system.failure + "."); draw();
  }

  // ---- what is seen ----
  const element = name => {  // "wrench.tau[2]" -> its place in the block
    const [, whole, k] = name.match(/^(.*?)(?:\[(\d+)\])?$/), row = system.rows.get(whole);
    return row.at + (k ? k - 1 : 0);
  };
  const movers = data.movers.map(m => ({ ...m, place: element(m.at), turn: m.q && element(m.q), thrusts: m.arrows.map(element), most: 0.1 }));
  function moveScene() {
    if (!window.uuvsimScene) return;
    const values = system.values, some = (at, n) => [...values.subarray(at, at + n)];
    movers.forEach((m, i) => {
      const thrusts = m.thrusts.map(at => values[at]);
      m.most = Math.max(m.most, ...thrusts.map(Math.abs));
      const q = m.turn ? some(m.turn, 4) : m.size ? turn(some(m.place + 3, 3)) : null;
      window.uuvsimScene.move(i, some(m.place, 3), q, thrusts.map(f => 1.5 * m.size * f / m.most));
    });
  }
  function turn([phi, theta, psi]) {  // a quaternion from Euler angles
    const [c, s] = [Math.cos, Math.sin].map(f => [phi, theta, psi].map(a => f(a / 2)));
    return [c[0] * c[1] * c[2] + s[0] * s[1] * s[2], s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
      c[0] * s[1] * c[2] + s[0] * c[1] * s[2], c[0] * c[1] * s[2] - s[0] * s[1] * c[2]];
  }
  let drawn = 0;
  function draw(now) {
    moveScene();
    if (now && now - drawn < 80) return;  // text and plots: about 12 times a second
    drawn = now || 0;
    find("#time").textContent = `t = ${system.time.toFixed(2)} s, ${system.steps.toLocaleString("en")} steps`;
    find("#hash").textContent = system.hash;
    const seconds = (performance.now() - began[0]) / 1000;
    if (running && seconds > 0.5) find("#rate").textContent = `${shown(+((system.time - began[1]) / seconds).toPrecision(3))} × real time`;
    for (const u of plots) u.setData([times.subarray(0, filled), ...u.columns.map(j => history[j].subarray(0, filled))]);
  }

  // ---- plots ----
  const STYLES = ["truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired"];
  const colour = name => getComputedStyle(root).getPropertyValue("--" + name).trim();
  const plots = new Set(), first = new Map();
  let column = 0;
  for (const row of data.table.output) { first.set(row.name, column); column += row.size; }
  const unitOf = (row, k) => row.units.length > 1 ? row.units[k] : row.units[0] || "";
  function swatch(style) {
    const fill = ["fifth", "sixth", "desired"].includes(style) ? "none" : `var(--${style})`;
    return `<svg viewBox="0 0 22 10"><path class="line ${style}" d="M0 5H22"/><path d="${data.marks[style]}" stroke="var(--${style})" fill="${fill}" transform="translate(11 5)"/></svg>`;
  }
  function plot(title, unit, lines) {
    const close = make("button", { type: "button", className: "close", textContent: "×" });
    close.setAttribute("aria-label", "remove " + title);
    const keys = make("span", { className: "keys" }), box = make("div", { className: "plot" });
    const card = make("div", { className: "card" }, make("h3", {}, title, make("span", { className: "unit", textContent: unit && unit !== "1" ? `[${unit}]` : "" }), keys, close), box);
    card.dataset.signal = title;
    find("#plots").append(card);
    const grid = { stroke: () => colour("grid"), width: 1 }, ink = { stroke: () => colour("muted"), font: "11px system-ui" };
    const u = new uPlot({
      width: box.clientWidth, height: box.clientHeight, legend: { show: false }, padding: [8, 20, 0, 0],
      scales: { x: { time: false, range: (_, low, high) => [low || 0, Math.max(high || 0, (low || 0) + 1)] }, y: { range: (_, low, high) => {
        const span = Math.max((high ?? 1) - (low ?? 0), 1e-6, 1e-6 * Math.abs(high ?? 0)), middle = ((low ?? 0) + (high ?? 1)) / 2;
        return [middle - 0.55 * span, middle + 0.55 * span];
      } } },
      series: [{}, ...lines.map((_, i) => ({ stroke: () => colour(STYLES[i]), width: 1.4, points: { show: false } }))],
      axes: [{ size: 30, space: 60, grid, ticks: { show: false }, ...ink, values: (_, splits) => splits.map((v, i) => shown(v) + (i === splits.length - 1 ? " s" : "")) },
        { size: 58, space: 28, grid, ticks: { show: false }, ...ink, values: (_, splits) => splits.map(v => shown(+v.toPrecision(6))) }],
      cursor: { sync: { key: "time", setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, y: false },
      hooks: { draw: [marks], setCursor: [read] },
    }, [[], ...lines.map(() => [])], box);
    u.columns = lines.map(l => l.column);
    u.values = lines.map(() => make("b", {}));
    lines.forEach((l, i) => {
      const key = make("button", { type: "button", className: "key", title: "hide or show", innerHTML: swatch(STYLES[i]) }, l.label, u.values[i]);
      key.setAttribute("aria-pressed", "true");
      key.onclick = () => {
        const on = key.getAttribute("aria-pressed") !== "true";
        key.setAttribute("aria-pressed", String(on)); u.setSeries(i + 1, { show: on });
      };
      keys.append(key);
    });
    const watch = new ResizeObserver(() => u.setSize({ width: box.clientWidth, height: box.clientHeight }));
    watch.observe(box);
    close.onclick = () => { watch.disconnect(); plots.delete(u); u.destroy(); card.remove(); };
    plots.add(u);
  }
  function read(u) {
    const i = u.cursor.left >= 0 ? u.cursor.idx : null;
    if (u.values) u.values.forEach((value, k) => { value.textContent = i === null || i === undefined || !filled ? "" : shown(+u.data[k + 1][i].toPrecision(5)); });
  }
  // About one mark in 90 pixels of a line, at different places for different lines.
  function marks(u) {
    const ratio = devicePixelRatio || 1, ctx = u.ctx, lines = u.series.length - 1;
    if (!u.data[0].length) return;
    for (let i = 0; i < lines; i++) {
      if (!u.series[i + 1].show) continue;
      const shape = new Path2D(data.marks[STYLES[i]]);
      for (let px = 90 * (i + 0.5) / lines; px < u.bbox.width / ratio; px += 90) {
        const at = u.posToIdx(px), x = u.valToPos(u.data[0][at], "x", true), y = u.valToPos(u.data[i + 1][at], "y", true);
        if (Math.abs((x - u.bbox.left) / ratio - px) > 45) continue;
        ctx.save(); ctx.translate(x, y); ctx.scale(ratio, ratio); ctx.lineWidth = 1.5;
        ctx.strokeStyle = ctx.fillStyle = colour(STYLES[i]);
        if (!["fifth", "sixth", "desired"].includes(STYLES[i])) ctx.fill(shape);
        ctx.stroke(shape); ctx.restore();
      }
    }
  }
  // An output gets a plot for each unit of its elements.
  function add(name) {
    const row = system.rows.get(name), units = new Map();
    for (let k = 0; k < row.size; k++) units.set(unitOf(row, k), [...units.get(unitOf(row, k)) || [], k]);
    for (const [unit, elements] of units) {
      plot(name, unit, elements.slice(0, STYLES.length).map(k => ({ label: row.shape.length ? `[${k + 1}]` : name.split(".").pop(), column: first.get(name) + k })));
    }
  }
  const outputs = data.table.output.map(row => row.name), search = find("#search");
  find("#signals").append(...outputs.map(value => make("option", { value })));
  search.placeholder = outputs[0] || "";
  search.onchange = () => {
    const text = search.value.trim(), name = outputs.includes(text) ? text : outputs.find(n => n.toLowerCase().includes(text.toLowerCase()));
    if (!text) return;
    if (name) { add(name); search.value = ""; draw(); }
    find("#hint").textContent = name ? `${name} is plotted below.` : `No output contains “${text}”.`;
  };

  // ---- parameters and inputs ----
  const limits = (row, start) => {
    let low = start < 0 ? 3 * start : start > 0 ? 0 : -1, high = start < 0 ? 0 : start > 0 ? 3 * start : 1;
    if (row.min !== null && row.max !== null) [low, high] = [row.min, row.max];
    else { if (row.min !== null) low = Math.max(low, row.min); if (row.max !== null) high = Math.min(high, row.max); }
    return [low, Math.max(high, low)];
  };
  function control(row, k) {
    const start = row.start[k], unit = unitOf(row, k), [low, high] = limits(row, start);
    const label = row.name.slice(row.name.lastIndexOf(".") + 1) + (row.shape.length ? `[${k + 1}]` : "");
    const slider = make("input", { type: "range", min: low, max: high, step: row.type === "Float64" ? (high - low) / 500 || "any" : 1, value: start });
    const field = make("input", { type: "number", step: "any", value: start });
    const line = make("div", { className: "row", title: row.text }, make("span", { textContent: label }), slider, field, make("i", { textContent: unit === "1" ? "" : unit }));
    for (const e of [slider, field]) e.setAttribute("aria-label", `${row.name} ${label} ${unit}`);
    const show = value => { slider.value = field.value = value; line.classList.toggle("changed", value !== start); };
    const set = value => {
      const refused = system.set(row.name, k, value);
      notice(refused);
      if (!refused) show(value);
    };
    slider.oninput = () => set(+slider.value);
    field.onchange = () => set(field.value === "" ? NaN : +field.value);
    line.ondblclick = () => set(start);
    return line;
  }
  const MOST = 8, groups = new Map();
  for (const row of [...data.table.input, ...data.table.parameter]) {
    if (!row.tunable || row.size > MOST) continue;
    const path = row.name.slice(0, row.name.lastIndexOf("."));
    if (!groups.has(path)) groups.set(path, make("details", {}, make("summary", { textContent: path })));
    const free = row.free || row.start.map((_, k) => k);
    groups.get(path).append(...free.map(k => control(row, k)));
  }
  find("#given").append(...groups.values());
  for (const group of [...groups.values()].slice(0, 1)) group.open = true;
  find("#filter").oninput = e => {
    const text = e.target.value.trim().toLowerCase();
    for (const [path, group] of groups) {
      let some = false;
      for (const line of group.querySelectorAll(".row")) {
        const hit = (path + "." + line.firstChild.textContent).toLowerCase().includes(text);
        line.hidden = !hit; some ||= hit;
      }
      group.hidden = !some; group.open = some && text !== "";
    }
  };

  // ---- buttons, colours ----
  find("#run").onclick = () => running ? pause() : run();
  find("#step").onclick = () => { pause(); advance(1); draw(); };
  find("#restart").onclick = restart;
  find("#speed").onchange = () => { began = [performance.now(), system.time]; };
  document.addEventListener("keydown", e => {
    if (e.key !== " " || /INPUT|SELECT|BUTTON|SUMMARY/.test(e.target.tagName)) return;
    e.preventDefault(); find("#run").click();
  });
  const redraw = () => { for (const u of plots) u.redraw(false); };
  find("#theme").onclick = () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark"; redraw();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  for (const name of data.plots) add(name);
  const [leader] = movers;
  if (leader) {
    add(leader.at);
    const speeds = leader.at.replace(/eta$/, "nu");
    if (system.rows.has(speeds)) add(speeds);
    if (leader.arrows.length) plot("thrusts", "N", leader.arrows.slice(0, STYLES.length).map((name, i) => {
      const [, whole, k] = name.match(/^(.*?)(?:\[(\d+)\])?$/);
      return { label: String(i + 1), column: first.get(whole) + (k ? k - 1 : 0) };
    }));
  } else if (!data.plots.length) outputs.slice(0, 4).forEach(add);
  window.uuvsimPage = { system, advance: n => { advance(n); draw(); }, run, pause, restart };
  restart();
  // What the link asks for; what cannot be understood is named, and the rest is done.
  const ASKED = {
    __proto__: null,
    theme: value => /^(light|dark)$/.test(value) && (root.dataset.theme = value, redraw(), true),
    steps: value => /^\d{1,7}$/.test(value) && (window.uuvsimPage.advance(+value), true),
  };
  for (const [name, value] of new URLSearchParams(location.hash.slice(1)))
    if (!ASKED[name] || !ASKED[name](value))
      notice(`The link has “${name}=${value}”, which is ignored: expected theme=light, theme=dark, or steps= and a whole number below 10,000,000.`);
})();
