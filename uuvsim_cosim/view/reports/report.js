"use strict";
// Plots of the report by uPlot: they share zoom and cursor; the data are those of `Plots.scripts`.
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement, plots = new Set();
  const find = (selector, within) => (within || document).querySelector(selector);
  const all = (selector, within) => [...(within || document).querySelectorAll(selector)];

  // ---- data ----
  function bytes(text) {
    const raw = atob(text), found = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
    return found.buffer;
  }
  const floats = text => new Float32Array(bytes(text));
  const times = data.times.map(g => Array.from(floats(g.t), v => g.start + v));
  const decoded = new Map();
  function column(number) {
    if (!decoded.has(number)) {
      const c = data.columns[number];
      decoded.set(number, c.v === undefined ? new Array(c.n).fill(c.c)
        : Array.from(new Uint16Array(bytes(c.v)), k => k === 65535 ? null : c.l + c.s * k));
    }
    return decoded.get(number);
  }
  const start = times[0][0], end = times[0][times[0].length - 1];

  // ---- labels and colours ----
  const colour = name => getComputedStyle(root).getPropertyValue("--" + name).trim();
  const minus = text => text.replace("-", "−");
  function shown(value, digits) {
    if (value === null || value === undefined) return "–";
    if (digits >= 0) return minus(value.toFixed(digits));
    const size = Math.abs(value);
    return minus(size && (size >= 1e6 || size < 1e-4) ? value.toExponential(3) : String(+value.toPrecision(5)));
  }
  const STEPS = [];
  for (let p = -6; p < 2; p++) for (const m of [1, 2, 5]) STEPS.push(m * 10 ** p);
  const LONG = [60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 36000, 86400, 432000];
  const unit = span => span < 240 ? ["s", 1] : span < 14400 ? ["min", 60] : ["h", 3600];
  function timeLabels(u, splits) {
    const [name, size] = unit(u.scales.x.max - u.scales.x.min);
    return splits.map((v, i) => minus(String(+(v / size).toPrecision(6))) + (i === splits.length - 1 ? " " + name : ""));
  }
  const open = line => line.run === 1;  // lines of the second run have hollow marks
  const stroked = style => style === "fifth" || style === "sixth" || style === "desired";

  // ---- one plot ----
  const HEIGHT = 30;  // of the time axis
  function options(spec, box) {
    const series = [{}], bands = [], scales = { x: { time: false } };
    const y = {
      dir: spec.down ? -1 : 1,
      range: (u, low, high) => {
        if (low === null) [low, high] = [0, 1];
        for (const v of spec.include || []) { low = Math.min(low, v); high = Math.max(high, v); }
        const whole = !(u.scales.x.min > start + 1e-3 || u.scales.x.max < end - 1e-3);
        if (spec.reach && whole) [low, high] = [Math.min(low, spec.reach[0]), Math.max(high, spec.reach[1])];
        const span = Math.max(high - low, spec.span || 0, 1e-9, 1e-6 * Math.abs(high)), middle = (low + high) / 2;
        return [middle - 0.55 * span, middle + 0.55 * span];
      },
    };
    for (const band of spec.bands || []) {
      for (const part of ["high", "low"]) series.push({ stroke: "transparent", scale: "y", auto: false, points: { show: false } });
      bands.push({ series: [series.length - 2, series.length - 1], fill: () => colour("band") });
    }
    const count = spec.lines.length, total = 2 * spec.rows * count;
    spec.lines.forEach((line, i) => {
      const scale = spec.rows ? "row" + i : "y";
      if (spec.rows) {
        const below = (count - 1 - i + 0.5) / count * total;
        scales[scale] = { range: () => [-below, total - below] };
      }
      series.push({
        stroke: () => colour(line.style), width: 1.4, scale, dash: line.dash ? [6, 4] : undefined,
        points: { show: false }, ...(spec.rows ? { fill: () => colour("extreme"), fillTo: 0 } : {}),
      });
    });
    if (!spec.rows) scales.y = y;
    const lines = { stroke: () => colour("grid"), width: 1 }, text = { stroke: () => colour("muted"), font: "11px system-ui" };
    const values = {
      scale: "y", size: 52, grid: lines, ticks: { show: false }, ...text, space: 28,
      values: (u, splits) => splits.map(v => minus(String(+v.toPrecision(6)))),
    };
    if (spec.rows) Object.assign(values, {
      scale: "row0", splits: u => spec.lines.map((_, i) => -2 * spec.rows * i), values: () => spec.lines.map(l => l.label),
    });
    return {
      width: box.clientWidth, height: box.clientHeight, legend: { show: false }, padding: [8, 12, 0, 0],
      series, bands, scales,
      axes: [{
        size: HEIGHT, space: 60, grid: lines, ticks: { show: false }, ...text, values: timeLabels,
        incrs: (u, k, low, high) => unit(high - low)[1] === 1 ? [...STEPS, 60] : LONG,
      }, values],
      cursor: { sync: { key: "time", setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, y: false },
      hooks: { setCursor: [moved], setScale: [zoomed], draw: [u => drawMarks(u, spec)] },
    };
  }
  // About one mark in 90 pixels of a line, at different places for different lines.
  function drawMarks(u, spec) {
    if (spec.rows) return;
    const ctx = u.ctx, ratio = devicePixelRatio || 1, every = 90, first = u.series.length - spec.lines.length;
    spec.lines.forEach((line, i) => {
      if (!u.series[first + i].show || !data.marks[line.style]) return;
      const shape = new Path2D(data.marks[line.style]);
      for (let px = every * (i + 0.5) / spec.lines.length; px < u.bbox.width / ratio; px += every) {
        const value = u.data[first + i][u.posToIdx(px)], at = u.data[0][u.posToIdx(px)];
        if (value === null || value === undefined) continue;
        const x = u.valToPos(at, "x", true), y = u.valToPos(value, "y", true);
        if (x < u.bbox.left || x > u.bbox.left + u.bbox.width || y < u.bbox.top || y > u.bbox.top + u.bbox.height) continue;
        ctx.save(); ctx.translate(x, y); ctx.scale(ratio, ratio);
        ctx.lineWidth = 1.5; ctx.strokeStyle = colour(line.style);
        ctx.fillStyle = open(line) ? colour("card") : ctx.strokeStyle;
        if (!stroked(line.style)) ctx.fill(shape);
        ctx.stroke(shape); ctx.restore();
      }
    });
  }
  function entry(u, text, picture, numbers, digits) {
    const key = document.createElement("button"), value = document.createElement("b");
    key.type = "button"; key.className = "key"; key.setAttribute("aria-pressed", "true");
    key.title = "hide or show"; key.innerHTML = picture;
    key.append(text, value);
    key.addEventListener("click", () => {
      const on = key.getAttribute("aria-pressed") !== "true";
      key.setAttribute("aria-pressed", String(on));
      for (const k of numbers) u.setSeries(k, { show: on });
    });
    u.values.push(i => { value.textContent = i === null ? "" : shown(u.data[numbers[0]][i], digits); });
    return key;
  }
  function swatch(line) {
    const dash = line.dash ? " dash" : "", fill = open(line) ? ' style="fill:var(--card)"' : "";
    return `<svg viewBox="0 0 22 10"><path class="line ${line.style}${dash}" d="M0 5H22"/>`
      + `<path class="marker ${line.style}"${fill} d="${data.marks[line.style] || ""}" transform="translate(11 5)"/></svg>`;
  }
  function make(card, spec) {
    const box = find(".plot", card), bands = spec.bands || [];
    const columns = [...bands.flatMap(b => [b.high, b.low]), ...spec.lines.map(l => l.column)];
    const u = new uPlot(options(spec, box), [times[spec.grid], ...columns.map(column)], box);
    u.values = [];
    const keys = find(".keys", card), first = 2 * bands.length + 1;
    if (!spec.rows) spec.lines.forEach((line, i) => keys.append(entry(u, line.label, swatch(line), [first + i], line.digits)));
    else {
      const picture = '<svg viewBox="0 0 22 10"><rect class="extreme" y="5" width="22" height="5"/><path class="line truth" d="M0 5H22"/></svg>';
      spec.lines.forEach((line, i) => keys.append(entry(u, line.label, picture, [first + i], line.digits)));
      const note = document.createElement("span");
      note.textContent = `height of a row: ±${shown(+spec.rows.toPrecision(3), -1)} ${spec.unit}`;
      keys.append(note);
    }
    bands.forEach((band, i) => keys.append(entry(u, band.label,
      '<svg viewBox="0 0 22 10"><rect class="band" width="22" height="10" rx="2"/></svg>', [2 * i + 1, 2 * i + 2], 3)));
    u.over.addEventListener("mouseenter", () => { pointed = u; });
    u.watch = new ResizeObserver(() => u.setSize({ width: box.clientWidth, height: box.clientHeight }));
    u.watch.observe(box);
    plots.add(u);
    const other = [...plots][0];
    if (other !== u) u.setScale("x", { min: other.scales.x.min, max: other.scales.x.max });
    return u;
  }

  // ---- cursor: the values in all legends, the track, the scene ----
  let pointed = null, busy = false;
  const clock = document.getElementById("clock"), plan = document.getElementById("track"), here = all(".here");
  const tracks = data.tracks.map(t => ({ time: floats(t.time), x: floats(t.x), y: floats(t.y), turn: floats(t.turn) }));
  function moved(u) {
    const i = u.cursor.left >= 0 ? u.cursor.idx : null;
    if (u.values) for (const show of u.values) show(i);
    if (u === pointed) shared(i === null || i === undefined ? null : u.data[0][i]);
  }
  function nearest(time, t) {
    let low = 0, high = time.length - 1;
    while (high - low > 1) { const m = (low + high) >> 1; if (time[m] < t) low = m; else high = m; }
    return t - time[low] < time[high] - t ? low : high;
  }
  function shared(t) {
    clock.classList.toggle("on", t !== null);
    here.forEach(h => h.classList.toggle("on", t !== null));
    under = t;
    if (t === null) return;
    clock.textContent = "t = " + minus(t.toFixed(2)) + " s";
    tracks.forEach((track, k) => {
      const i = nearest(track.time, t);
      here[k].setAttribute("transform", `translate(${track.x[i]} ${track.y[i]}) rotate(${track.turn[i]}) scale(1.5)`);
    });
    if (window.uuvsimScene) window.uuvsimScene.at(t);
  }
  function show(t) {  // as if the pointer were there in all plots
    pointed = null; shared(t);
    for (const u of plots) u.setCursor(t === null ? { left: -10, top: -10 } : { left: u.valToPos(t, "x"), top: 5 });
  }
  if (plan && tracks.length) {
    plan.addEventListener("pointermove", e => {
      const box = plan.getBoundingClientRect(), zoom = plan.viewBox.baseVal.width / box.width;
      const x = (e.clientX - box.left) * zoom, y = (e.clientY - box.top) * zoom, track = tracks[0];
      let best = -1, least = 900;
      for (let i = 0; i < track.time.length; i++) {
        const d = (track.x[i] - x) ** 2 + (track.y[i] - y) ** 2;
        if (d < least) { least = d; best = i; }
      }
      show(best < 0 ? null : track.time[best]);
    });
    plan.addEventListener("pointerleave", () => show(null));
  }

  // ---- run again from a time: the one of the last click ----
  const again = document.getElementById("again-time"), link = document.getElementById("again-link");
  let under = null;
  function from(t) {
    const tick = +again.dataset.tick, step = Math.round(Math.min(Math.max(t, 0), +again.max) / tick);
    again.value = +(step * tick).toPrecision(12);
    link.href = link.getAttribute("href").replace(/#.*|$/, `#steps=${step}`);
  }
  if (again) {
    again.onchange = () => from(+again.value);
    document.addEventListener("click", e => { if (under !== null && e.target.closest && e.target.closest(".u-over, #track")) from(under); });
    from(0);
  }

  // ---- zoom of all plots ----
  function range(low, high) {
    const span = Math.min(high - low, end - start);
    if (!(span > 1e-9)) return;
    low = Math.max(start, Math.min(low, end - span));
    busy = true;
    for (const u of plots) u.setScale("x", { min: low, max: low + span });
    // uPlot applies a scale after this script has returned.
    queueMicrotask(() => queueMicrotask(() => { busy = false; }));
  }
  function zoomed(u, key) {
    if (key !== "x" || busy || !plots.has(u)) return;
    range(u.scales.x.min, u.scales.x.max);
  }
  const ZOOM = { in: [0.25, 0.75], out: [-0.5, 1.5], back: [-0.5, 0.5], on: [0.5, 1.5], all: null };
  all("[data-zoom]").forEach(button => button.addEventListener("click", () => {
    const [u] = plots, part = ZOOM[button.dataset.zoom];
    if (!u) return;
    const { min, max } = u.scales.x, span = max - min;
    if (part) range(min + part[0] * span, min + part[1] * span); else range(start, end);
  }));

  // ---- search: any recorded signal as a plot ----
  const search = document.getElementById("search"), added = document.getElementById("added"), hint = document.getElementById("hint");
  function add(name) {
    for (const spec of data.signals[name]) {
      const card = document.createElement("div"), close = document.createElement("button");
      card.className = "card"; card.dataset.signal = name;
      card.innerHTML = '<h3><span class="name"></span> <span class="unit"></span><span class="keys"></span></h3><div class="plot"></div>';
      find(".name", card).textContent = spec.title;
      find(".unit", card).textContent = spec.unit ? `[${spec.unit}]` : "";
      close.type = "button"; close.className = "close"; close.textContent = "×"; close.setAttribute("aria-label", "remove " + spec.title);
      find("h3", card).append(close);
      added.append(card);
      const u = make(card, spec);
      close.addEventListener("click", () => { u.watch.disconnect(); plots.delete(u); u.destroy(); card.remove(); });
    }
    hint.textContent = `${name} is plotted below.`;
  }
  function searched(whole) {
    const text = search.value.trim(), names = Object.keys(data.signals);
    const name = text in data.signals ? text : whole && text && names.find(n => n.toLowerCase().includes(text.toLowerCase()));
    if (name) { add(name); search.value = ""; } else if (whole && text) hint.textContent = `No recorded signal contains “${text}”.`;
  }
  if (search) {
    search.addEventListener("input", e => { if (!(e instanceof InputEvent) || e.inputType === "insertReplacementText") searched(false); });
    search.addEventListener("keydown", e => { if (e.key === "Enter") { e.preventDefault(); searched(true); } });
    search.addEventListener("change", () => searched(false));
  }

  // ---- theme, address ----
  const redraw = () => { for (const u of plots) u.redraw(false); };
  document.getElementById("theme").addEventListener("click", () => {
    const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
    redraw();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  all("[data-plot]").forEach(card => make(card, data.panels[+card.dataset.plot]));
  // #signal=hull.nu&from=10&to=20&t=15&theme=dark opens the report at what is named.
  const asked = new URLSearchParams(location.hash.slice(1));
  if (asked.has("theme")) { root.dataset.theme = asked.get("theme"); redraw(); }
  asked.getAll("signal").filter(name => name in data.signals).forEach(add);
  if (asked.has("from") && asked.has("to")) range(+asked.get("from"), +asked.get("to"));
  if (asked.has("t")) setTimeout(() => show(+asked.get("t")), 0);
})();
