// The page of a system that runs in the browser: controls, parameters, plots, and the scene's motion.
(async function () {
  const find = selector => document.querySelector(selector), root = document.documentElement;
  const data = JSON.parse(find("#data").textContent);
  const notice = (text, plain) => { find("#notice").textContent = text; find("#notice").classList.toggle("plain", Boolean(plain)); };
  const told = text => notice(text, true);  // not an error
  const make = (tag, more, ...inside) => { const e = Object.assign(document.createElement(tag), more); e.append(...inside); return e; };
  const shown = value => String(+value.toPrecision(6)).replace("-", "−");

  // ---- the system ----
  async function unpacked(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    return new Response(stream).arrayBuffer();
  }
  let system, line;
  try {
    system = new System(data.table, await unpacked(data.module));
  } catch (error) {
    const missing = typeof WebAssembly !== "object" ? "WebAssembly" : typeof DecompressionStream !== "function" ? "DecompressionStream" : "";
    notice(missing ? `This browser has no ${missing}, or it is switched off, so that the system cannot run here. Browsers since 2023 have it.`
      : `The system cannot start: ${error.message}`);
    document.querySelectorAll("button:not(#theme), select, input, #plan").forEach(e => { e.disabled = true; });
    return;
  }
  line = new Timeline(system);

  // ---- history of all outputs: equal distances in time; every second point goes when it is full ----
  const POINTS = 4000, columns = system.columns.length;
  const times = new Float64Array(POINTS), history = Array.from({ length: columns }, () => new Float64Array(POINTS));
  let filled = 0, every = 1, steering = null;
  function keep() {
    if (line.steps / every >= POINTS) {
      for (const list of [times, ...history]) for (let k = 0; 2 * k < POINTS; k++) list[k] = list[2 * k];
      every *= 2; line.every = every;
      if (line.steps % every) return;
    }
    const values = system.values, at = line.steps / every;
    times[at] = system.time;
    for (let j = 0; j < columns; j++) history[j][at] = values[system.columns[j]];
    filled = at + 1;
    moveScene();
  }
  const ended = () => data.ended !== "" && system.values[element(data.ended)] > 0.5;
  function advance(n) {
    const before = ended();
    for (const end = line.steps + n; line.steps < end;) {
      if (steering) steering.beat();
      const piece = steering && steering.on ? steering.every - line.steps % steering.every : end;
      if (!line.advance(Math.min(piece, end - line.steps))) { pause(); notice(line.failure + "."); return false; }
    }
    if (!before && ended()) { pause(); told(`The episode has ended: ${data.ended} is 1. The system itself can run on.`); }
    return true;
  }

  // ---- run, pause, step ----
  const SLICE = 14;  // ms of a frame for computing
  let running = false, last = 0, owed = 0, began = [0, 0];
  function pause() {
    const was = running;
    running = false; find("#run").textContent = "run"; find("#rate").textContent = "";
    if (was) refresh();  // what is shown is up to 80 ms old
  }
  function run() {
    if (line.failure) return;
    notice(""); running = true; last = performance.now(); owed = 0; began = [last, system.time];
    find("#run").textContent = "pause"; next();
  }
  let asked = 0;
  function next() { cancelAnimationFrame(asked); asked = requestAnimationFrame(frame); }
  function frame(now) {
    if (!running || document.hidden) return;
    const speed = +find("#speed").value, until = performance.now() + SLICE;
    owed = Math.min(owed + (Math.max(0, now - last) / 1000 * speed / system.tick || 0), 1e9); last = now;
    let part = Math.max(1, Math.min(64, every));
    while (owed >= 1 && performance.now() < until) {
      const n = Math.min(Math.floor(owed), data.ended && !ended() ? 1 : part);
      if (!advance(n) || !running) break;
      owed -= n; part *= 2;
      if (part > 4096) part = 4096;
    }
    if (owed > speed / system.tick) owed = 0;  // the machine is too slow for this speed
    draw(now);
    next();
  }
  // After a jump in time, or changed events: plots, track and fields show this point.
  function refresh() {
    filled = Math.min(filled, Math.floor(line.steps / every) + 1);
    owed = 0; began = [performance.now(), system.time];
    if (line.failure) pause();
    retrace();
    for (const sync of controls) sync();
    find("#seed").value = system.seed;
    find("#back").disabled = line.steps === 0;
    if (waypoints) waypoints.sync();
    if (happens) happens.show();
    draw();
  }
  function again(begin) {
    if (steering) steering.release();
    filled = 0; every = line.every = 1;
    begin();
    notice(line.failure && line.failure + ".");
    refresh();
  }
  const restart = () => again(() => line.restart());
  const seek = step => { pause(); line.seek(Math.max(0, step)); notice(line.failure && line.failure + "."); refresh(); };
  // A browser does not run a page in the background.
  let left = 0;
  document.addEventListener("visibilitychange", () => {
    if (!running) return;
    if (document.hidden) { left = performance.now(); return; }
    told(`This page was in the background for ${shown(+((performance.now() - left) / 1000).toPrecision(2))} s, where the browser does not run it. It goes on from t = ${system.time.toFixed(2)} s.`);
    last = performance.now(); owed = 0; began = [last, system.time];
    next();
  });

  // ---- what is seen ----
  const first = new Map();  // an output's first column in the history
  let column = 0;
  for (const row of data.table.output) { first.set(row.name, column); column += row.size; }
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
  function retrace() {  // the tracks of the scene, from the history
    if (!window.uuvsimScene) return;
    window.uuvsimScene.clear();
    movers.forEach((m, i) => {
      const from = first.get(m.at), step = Math.max(1, Math.floor(filled / 1000));
      for (let k = 0; k < filled; k += step) window.uuvsimScene.move(i, [0, 1, 2].map(d => history[from + d][k]));
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
    find("#back").disabled = line.steps === 0;
    if (waypoints) waypoints.move();
    const seconds = (performance.now() - began[0]) / 1000;
    if (running && seconds > 0.5) find("#rate").textContent = `${shown(+((system.time - began[1]) / seconds).toPrecision(3))} × real time`;
    for (const u of plots) u.setData([times.subarray(0, filled), ...u.columns.map(j => history[j].subarray(0, filled))]);
  }

  // ---- plots ----
  const STYLES = ["truth", "estimate", "third", "fourth", "fifth", "sixth", "seventh", "desired"];
  const colour = name => getComputedStyle(root).getPropertyValue("--" + name).trim();
  const plots = new Set();
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
    card.dataset.signal = title; card.dataset.unit = unit;
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
  const controls = [];  // each shows the present value
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
    const entry = make("div", { className: "row", title: row.text }, make("span", { textContent: label }), slider, field, make("i", { textContent: unit === "1" ? "" : unit }));
    for (const e of [slider, field]) e.setAttribute("aria-label", `${row.name} ${label} ${unit}`);
    const show = value => { slider.value = field.value = value; entry.classList.toggle("changed", value !== start); };
    const set = value => {
      const refused = line.set(row.name, k, value);
      notice(refused);
      if (refused) return;
      show(value);
      if (happens) happens.show();
      if (!running) draw();
    };
    controls.push(() => show(line.value(row.name, k)));
    slider.oninput = () => set(+slider.value);
    field.onchange = () => set(field.value === "" ? NaN : +field.value);
    entry.ondblclick = () => set(start);
    return entry;
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
      for (const row of group.querySelectorAll(".row")) {
        const hit = (path + "." + row.firstChild.textContent).toLowerCase().includes(text);
        row.hidden = !hit; some ||= hit;
      }
      group.hidden = !some; group.open = some && text !== "";
    }
  };

  // ---- buttons, colours ----
  find("#seed").parentElement.hidden = find("#download").hidden = !data.named;
  find("#run").onclick = () => running ? pause() : run();
  find("#step").onclick = () => { pause(); notice(""); advance(1); draw(); };
  find("#back").onclick = () => seek(line.steps - 1);
  find("#restart").onclick = restart;
  find("#replay").onclick = () => again(() => line.seek(0));
  find("#speed").onchange = () => { began = [performance.now(), system.time]; };
  find("#seed").onchange = e => {
    const seed = Number(e.target.value);
    if (Number.isInteger(seed) && seed >= 0 && seed < 2 ** 31) again(() => line.reseed(seed));
    else { notice("The seed is a whole number from 0 to 2147483647."); e.target.value = system.seed; }
  };
  document.addEventListener("keydown", e => {
    if (/INPUT|SELECT|BUTTON|SUMMARY|CANVAS/.test(e.target.tagName) || e.ctrlKey || e.metaKey || e.altKey) return;
    const button = { " ": "#run", ",": "#back", ".": "#step" }[e.key];
    if (button) { e.preventDefault(); find(button).click(); }
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
  // ---- waypoints, faults, steering, link ----
  const track = () => leader ? [0, 1].map(i => history[first.get(leader.at) + i].subarray(0, filled)) : [[], []];
  const plotCards = () => [...document.querySelectorAll("#plots [data-signal]")], plotKey = card => `${card.dataset.signal} ${card.dataset.unit}`;
  const shownPlots = () => plotCards().map(plotKey);
  const settings = () => ({ ...line.settings(), hash: system.hash, speed: find("#speed").value, ...(root.dataset.theme ? { theme: root.dataset.theme } : {}),
    plots: shownPlots() });
  const page = { data, system, line, find, make, shown, notice, told, run, pause, restart, seek, refresh, track, settings, running: () => running,
    advance: n => { advance(n); refresh(); } };
  const waypoints = data.path && leader ? waypointsCard(page, { ...data.path, eta: Array.from({ length: 6 }, (_, i) => system.rows.get(leader.at).at + i) }) : null;
  const happens = eventsCard(page);
  steering = data.steered.length ? steeringCard(page, data.steered) : null;
  line.observe = keep;
  again(() => line.load(data.given));
  // What the link asks for; what cannot be understood is named, and the rest is done.
  const THEMES = /^(light|dark)$/, theme = value => { root.dataset.theme = value; redraw(); };
  const speeds = [...find("#speed").options].map(o => o.value);
  const speed = value => speeds.includes(value) && (find("#speed").value = value, true);
  async function linked(text) {
    let found;
    try { found = await settingsOf(text); } catch {
      return `The link is damaged: its ${text.length.toLocaleString("en")} characters after “link=” cannot be read; expected a link that this page has made. Its settings are ignored.`;
    }
    if (found?.system !== data.table.name) return `The link has settings of the system “${found?.system}”; expected ${data.table.name}. They are ignored.`;
    const refused = [];
    again(() => refused.push(...line.load(found)));
    if (THEMES.test(found.theme)) theme(found.theme);
    speed(found.speed);
    if (Array.isArray(found.plots)) {
      const missing = found.plots.filter(key => !shownPlots().includes(key)).map(key => key.split(" ")[0]);
      for (const name of new Set(missing)) if (system.rows.has(name)) add(name);
      for (const card of plotCards()) if (!found.plots.includes(plotKey(card))) card.querySelector(".close").click();
      draw();
    }
    if (refused.length) return `This system refuses ${refused.length === 1 ? "a setting" : `${refused.length} settings`} of the link: ${refused[0]}`;
    if (found.hash && found.hash !== system.hash) return `At this point the link was made with the hash ${found.hash}: by another version of this page, whose bits differ.`;
    return "";
  }
  const whole = /^\d{1,7}$/, ASKED = {
    __proto__: null,
    theme: value => THEMES.test(value) && (theme(value), true),
    seed: value => whole.test(value) && (again(() => line.reseed(+value)), true),
    speed,
    steps: value => whole.test(value) && (page.advance(+value), true),
    link: async value => { const why = await linked(value); if (why) notice(why); return true; },
  };
  async function follow() {
    for (const [name, value] of new URLSearchParams(location.hash.slice(1)))
      if (!ASKED[name] || !await ASKED[name](value))
        notice(`The link has “${name}=${value}”, which is ignored: expected theme=light, theme=dark, seed= or steps= and a whole number below 10,000,000, speed= and one of ${speeds.join(", ")}, or link= and settings.`);
  }
  window.addEventListener("hashchange", follow);
  await follow();
  window.uuvsimPage = page;
})();
