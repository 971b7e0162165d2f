// Live responses on the pages of components, after uPlot and system.js. `live_components.py` writes the data.
async function unpacked(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Response(stream).arrayBuffer();
}

// ---- the response: no document, so that node computes it as well ----
class StepResponse {
  constructor(data, module) {
    this.data = data;
    this.system = new System(data.table, module);
    this.after = new Map(Object.entries(data.after));  // "tau[1]" -> its value after the step
  }
  static async of(data) { return new StepResponse(data, await unpacked(data.module)); }
  // The row of an element, and its place in the row: "tau[2]" -> [row of tau, 1].
  element(name) {
    const [, whole, k] = name.match(/^(.*?)(?:\[(\d+)\])?$/);
    return [this.system.rows.get(whole), k ? k - 1 : 0];
  }
  // Run from time 0; return the times and all outputs at the points of the plots.
  compute() {
    const { system, data } = this, times = [], rows = [];
    const before = [...this.after].map(([name, value]) => {
      const [row, k] = this.element(name), old = system.values[row.at + k];
      return [row.at + k, old, value];
    });
    const clocks = data.clocks.map(name => system.rows.get(name).at);
    const keep = () => { times.push(system.time); rows.push(system.outputs()); };
    for (const at of clocks) system.values[at] = 0;
    system.begin();
    keep();
    while (system.steps < data.steps && !system.failure) {
      if (system.steps === data.at) for (const [at, , value] of before) system.values[at] = value;
      for (const at of clocks) system.values[at] = system.time;
      const next = clocks.length ? 1 : data.every - system.steps % data.every;
      const until = system.steps < data.at ? data.at : data.steps;
      system.run(Math.min(next, until - system.steps));
      if (system.steps % data.every === 0 || system.steps === data.at) keep();
    }
    for (const [at, old] of before) system.values[at] = old;
    return { times, rows, hash: system.hash, failure: system.failure };
  }
}

// ---- the page ----
const make = (tag, more, ...inside) => { const e = Object.assign(document.createElement(tag), more); e.append(...inside); return e; };
const shown = value => String(+value.toPrecision(5)).replace("-", "−");
const COLOURS = ["#2a7fb8", "#d1711f", "#3a9a5b", "#b8457a", "#7d6bb8", "#8a8a2a", "#1f9aa8", "#a0522d"];
const unitOf = (row, k) => (row.units.length > 1 ? row.units[k] : row.units[0]) || "";
const nameOf = (row, k) => row.name + (row.shape.length ? `[${k + 1}]` : "");

class ResponseView {
  constructor(place, response) {
    Object.assign(this, { place, response, plots: [], changed: new Set() });
    const { table } = response.data;
    this.first = response.compute();
    this.column = new Map();
    let column = 0;
    for (const row of table.output) { this.column.set(row.name, column); column += row.size; }
    this.notice = make("p", { className: "live-notice" });
    this.notice.setAttribute("role", "status");
    this.note = make("small", {}, "hash of all outputs at all steps: ", this.hash = make("code"));
    this.note.className = "live-hash";
    this.panel = make("div", { className: "live-plots" });
    const restore = make("button", { type: "button", textContent: "restore all", onclick: () => this.restore() });
    this.steps = make("div", { className: "live-steps" });
    this.controls = make("div", { className: "live-controls" }, this.steps, this.search(), this.parameters(), restore);
    place.append(make("div", { className: "live-columns" }, make("div", {}, this.choice(), this.panel, make("small", { className: "live-legend", textContent: "Dashed: with the values of this page. Solid: with yours." })), this.controls), this.notice, this.note);
    this.stepControls();
    const usual = table.output.filter(row => !/valid|t_sample|^q$/.test(row.name)).slice(0, 4).map(row => row.name);
    for (const name of response.data.shown.length ? response.data.shown : usual.length ? usual : [table.output[0].name]) this.add(name);
    this.draw(this.first);
  }
  later() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.draw(this.response.compute()); });
  }
  draw(found) {
    this.found = found;
    this.hash.textContent = found.hash;
    this.notice.textContent = found.failure ? `${found.failure}. The response ends here.` : "";
    for (const u of this.plots) this.fill(u);
  }
  fill(u) {
    const times = this.found.times, of = (run, j) => times.map((_, i) => i < run.rows.length ? run.rows[i][j] : null);
    u.setData([times, ...u.columns.map(j => of(this.first, j)), ...u.columns.map(j => of(this.found, j))]);
  }
  // ---- plots ----
  choice() {
    const select = make("select", {}, make("option", { value: "", textContent: "plot another output …" }));
    select.setAttribute("aria-label", "plot another output");
    for (const row of this.response.data.table.output) select.append(make("option", { value: row.name, textContent: row.name }));
    select.onchange = () => { if (select.value) { this.add(select.value); this.plots.slice(-3).forEach(u => this.fill(u)); } select.value = ""; };
    return select;
  }
  // An output has a plot for each unit of its elements; of many elements, some are shown.
  add(name) {
    const row = this.response.system.rows.get(name), units = new Map();
    for (let k = 0; k < row.size; k++) units.set(unitOf(row, k), [...units.get(unitOf(row, k)) || [], k]);
    for (const [unit, elements] of units) {
      const few = elements.length <= COLOURS.length ? elements : COLOURS.slice(0, 5).map((_, i) => elements[Math.round(i * (elements.length - 1) / 4)]);
      this.plot(row, unit, few);
    }
    if (this.found) this.draw(this.found);
  }
  plot(row, unit, elements) {
    const box = make("div", { className: "live-plot" }), keys = make("span", { className: "live-keys" });
    const close = make("button", { type: "button", textContent: "×" });
    close.setAttribute("aria-label", "remove " + row.name);
    const head = make("h4", {}, row.name + (unit && unit !== "1" ? ` [${unit}]` : ""), keys, close);
    const card = make("div", { className: "live-card" }, head, box);
    card.dataset.output = row.name;
    this.panel.append(card);
    const ink = () => getComputedStyle(this.place).getPropertyValue("--color-foreground-muted") || "#777";
    const grid = { stroke: "#8883", width: 1 }, axis = { stroke: ink, font: "11px system-ui", grid, ticks: { show: false } };
    const lines = elements.map((k, i) => ({ k, colour: COLOURS[i], column: this.column.get(row.name) + k }));
    const u = new uPlot({
      width: box.clientWidth || 300, height: 150, legend: { show: false }, padding: [6, 12, 0, 0],
      scales: { x: { time: false }, y: { range: (_, low, high) => {
        const span = Math.max((high ?? 1) - (low ?? 0), 1e-6, 1e-6 * Math.abs(high ?? 0)), middle = ((low ?? 0) + (high ?? 1)) / 2;
        return [middle - 0.55 * span, middle + 0.55 * span];
      } } },
      series: [{}, ...lines.map(l => ({ stroke: "#8889", dash: [5, 4], width: 1.3, points: { show: false } })),
        ...lines.map(l => ({ stroke: l.colour, width: 1.7, points: { show: false } }))],
      axes: [{ ...axis, size: 26, space: 50, values: (_, s) => s.map((v, i) => shown(v) + (i === s.length - 1 ? " s" : "")) },
        { ...axis, size: 54, space: 26, values: (_, s) => s.map(shown) }],
      cursor: { drag: { x: true, y: false }, y: false }, hooks: { setCursor: [read] },
    }, [[], ...lines.flatMap(() => [[], []])], box);
    u.columns = lines.map(l => l.column);
    const values = lines.map(l => make("b"));
    function read(u) {
      const i = u.cursor.left >= 0 ? u.cursor.idx : null;
      if (values) values.forEach((e, n) => { const v = i === null || i === undefined ? null : u.data[lines.length + n + 1][i]; e.textContent = v === null || v === undefined ? "" : " " + shown(v); });
    }
    lines.forEach((l, n) => {
      const key = make("span", {}, row.shape.length ? `[${l.k + 1}]` : "", values[n]);
      key.style.color = l.colour;
      keys.append(key);
    });
    const watch = new ResizeObserver(() => box.clientWidth && u.setSize({ width: box.clientWidth, height: 150 }));
    watch.observe(box);
    close.onclick = () => { watch.disconnect(); this.plots = this.plots.filter(p => p !== u); u.destroy(); card.remove(); };
    this.plots.push(u);
  }
  // ---- sliders ----
  // A slider and a field of one number: `set(value)` returns why not, or "".
  row(label, text, unit, start, [low, high], whole, set) {
    const step = whole ? 1 : (high - low) / 400 || "any";
    const slider = make("input", { type: "range", min: low, max: high, step, value: start });
    const field = make("input", { type: "number", step: "any", value: start });
    const line = make("div", { className: "live-row", title: `${text} Double click: ${shown(start)}.` }, make("span", { textContent: label }), slider, field, make("i", { textContent: unit === "1" ? "" : unit }));
    for (const e of [slider, field]) e.setAttribute("aria-label", `${label} ${unit}`);
    line.put = value => {
      const refused = set(value);
      this.notice.textContent = refused;
      if (refused) return;
      slider.value = field.value = value;
      line.classList.toggle("changed", value !== start);
      this.later();
    };
    line.restore = () => line.put(start);
    slider.oninput = () => line.put(+slider.value);
    field.onchange = () => line.put(field.value === "" ? NaN : +field.value);
    line.ondblclick = line.restore;
    return line;
  }
  limits(row, start, wide = 3) {
    let low = start < 0 ? wide * start : start > 0 ? 0 : -1, high = start < 0 ? 0 : start > 0 ? wide * start : 1;
    if (row.min !== null && row.max !== null) return [row.min, row.max];
    if (row.min !== null) low = Math.max(low, row.min);
    if (row.max !== null) high = Math.min(high, row.max);
    return [low, Math.max(high, low)];
  }
  parameters() {
    const { table, most } = this.response.data, list = make("div", { className: "live-given" });
    const add = (title, rows) => {
      const lines = rows.flatMap(row => Array.from({ length: row.size }, (_, k) => k).map(k => this.row(
        nameOf(row, k), row.text, unitOf(row, k), row.start[k], this.limits(row, row.start[k]), row.type !== "Float64",
        value => this.response.system.set(row.name, k, value))));
      if (lines.length) list.append(make("h4", { textContent: title }), ...lines);
    };
    add("Parameters", table.parameter.filter(row => row.size <= most));
    add("Inputs before the step", table.input.filter(row => row.size <= most && !this.response.data.clocks.includes(row.name)));
    this.lines = [...list.querySelectorAll(".live-row")];
    this.list = list;
    return list;
  }
  search() {
    const field = make("input", { type: "search", placeholder: "find a parameter" });
    field.setAttribute("aria-label", "find a parameter");
    field.oninput = () => { for (const line of this.lines) line.hidden = !line.firstChild.textContent.toLowerCase().includes(field.value.trim().toLowerCase()); };
    return field;
  }
  // The inputs that step, each with the value after the step; another one can be added.
  stepControls() {
    const { after, system } = this.response, { table } = this.response.data;
    if (!table.input.length) return;
    const select = make("select", {}, make("option", { value: "", textContent: "step another input …" }));
    select.setAttribute("aria-label", "step another input");
    const line = name => {
      const [row, k] = this.response.element(name), value = after.get(name), start = row.start[k];
      const around = this.limits(row, value === start ? 0 : value, 2), limits = row.min === null && around[0] === 0 ? [-around[1], around[1]] : around;
      return this.row(name, row.text, unitOf(row, k), value, limits, row.type !== "Float64", v => {
        if (!Number.isFinite(v)) return `${name} needs a number.`;
        if (row.type !== "Float64" && v !== Math.round(v)) return `${name} needs a whole number.`;
        if (!row.soft && (row.min !== null && v < row.min || row.max !== null && v > row.max)) return `${name} is from ${row.min ?? "−∞"} to ${row.max ?? "∞"}.`;
        after.set(name, v);
        return "";
      });
    };
    const steps = make("div", {}, ...[...after.keys()].map(line));
    for (const row of table.input) if (row.size <= 8 && !this.response.data.clocks.includes(row.name))
      for (let k = 0; k < row.size; k++) select.append(make("option", { value: nameOf(row, k), textContent: nameOf(row, k) }));
    select.onchange = () => {
      const name = select.value;
      select.value = "";
      if (!name || after.has(name)) return;
      const [row, k] = this.response.element(name);
      after.set(name, row.start[k]);
      steps.append(line(name));
    };
    this.steps.append(make("h4", { textContent: "After the step" }), steps, select);
    this.stepLines = () => [...steps.children];
  }
  restore() { for (const line of [...this.lines, ...this.stepLines ? this.stepLines() : []]) line.restore(); }
}

const uuvsimLive = {
  data: {},
  StepResponse,
  component(name, data) {
    this.data[name] = data;
    if (typeof document === "undefined") return;
    for (const place of document.querySelectorAll(`[data-live="${name}"]`)) this.begin(place, data);
  },
  async begin(place, data) {
    try {
      place.view = new ResponseView(place, await StepResponse.of(data));
    } catch (error) {
      const missing = typeof WebAssembly !== "object" ? "WebAssembly" : typeof DecompressionStream !== "function" ? "DecompressionStream" : "";
      place.textContent = missing ? `This browser has no ${missing}, or it is switched off, so that the component cannot run here. Browsers since 2023 have it.`
        : `The component cannot start: ${error.message}`;
    }
  },
};
globalThis.uuvsimLive = uuvsimLive;
