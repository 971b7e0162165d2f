// A run of a system that can be repeated and gone back in: start values, and events at communication
// points. Its events are those of a scenario of the master (orchestrator/scenarios), with the same bits.
//
// A change {at, name, element, value} acts in the step from point `at` on. A fault {at, until, signal,
// element (null: all), kind, value} acts at the points in [at, until). The state at a point is the one
// before the events that are due there; they are applied when the next step is made.
const FAULTS = ["override", "bias", "scale", "freeze", "delay", "drop"];
class Timeline {
  constructor(system) {
    this.system = system;
    this.events = [];
    this.serial = 0;
    this.every = 1;         // `observe` is called at these points, and at the start
    this.observe = () => {};
    this.signals = new Map(system.table.output.map((row, number) => [row.name, { row, number }]));
    this.given = [...system.table.input, ...system.table.parameter];
    this.begin();
  }
  get steps() { return this.system.steps; }
  get failure() { return this.problem || this.system.failure; }
  // Begin at time 0 from the present values; events stay.
  begin() {
    this.system.begin();
    this.startSeed = this.system.seed;
    this.start = this.system.values.slice();
    this.active = new Map();  // fault -> its numbers in the system
    this.stride = 64;
    this.snapshots = [];
    this.problem = "";
    this.keep();
    this.observe();
  }
  // ---- stepping ----
  // Make n steps with the events that are due between them; return whether all were made.
  advance(n) {
    const end = this.steps + n, { system } = this;
    while (this.steps < end && !this.failure) {
      this.applyDue();
      if (this.problem) break;
      const to = Math.min(end, this.nextDue(this.steps), ...[this.every, this.stride].map(every => (Math.floor(this.steps / every) + 1) * every));
      const wanted = to - this.steps, made = system.run(wanted);
      if (this.steps % this.stride === 0) this.keep();
      if (this.steps % this.every === 0) this.observe();
      if (made < wanted) break;
    }
    return this.steps === end && !this.failure;
  }
  // Go to a step, back or on.
  seek(step) {
    if (step < this.steps) {
      const kept = this.snapshots.findLast(s => s.steps <= step);
      this.system.restore(kept);
      this.active = new Map(kept.active);
      this.problem = "";
    }
    return this.advance(step - this.steps);
  }
  keep() {
    const { steps } = this, last = this.snapshots.at(-1);
    if (last && last.steps >= steps) return;
    this.snapshots.push({ ...this.system.save(), active: [...this.active] });
    if (this.snapshots.length > 128) {
      this.stride *= 2;
      this.snapshots = this.snapshots.filter(s => s.steps % this.stride === 0);
    }
  }
  // ---- events ----
  static acts(event) {  // points at which it is applied: a fault before the step to its first point
    return event.kind ? [Math.max(0, event.at - 1), Math.max(0, event.until - 1)] : [event.at];
  }
  // Events in the order in which the master applies them.
  get ordered() { return [...this.events].sort((a, b) => a.at - b.at || a.serial - b.serial); }
  nextDue(step) {
    if (!this.due) {
      this.due = new Map();
      for (const event of this.ordered) Timeline.acts(event).forEach((tick, k) => {
        if (!Number.isFinite(tick)) return;
        if (!this.due.has(tick)) this.due.set(tick, []);
        this.due.get(tick).push([event, k]);
      });
      this.ticks = [...this.due.keys()].sort((a, b) => a - b);
    }
    let low = 0, high = this.ticks.length;
    while (low < high) { const m = (low + high) >> 1; if (this.ticks[m] > step) high = m; else low = m + 1; }
    return low < this.ticks.length ? this.ticks[low] : Infinity;
  }
  applyDue() {
    this.nextDue(this.steps);
    for (const [event, ends] of this.due.get(this.steps) || []) {
      if (!event.kind) this.system.put(event.name, event.element, event.value);
      else if (ends) { for (const id of this.active.get(event) || []) this.system.clearFault(id); this.active.delete(event); }
      else {
        const { row, number } = this.signals.get(event.signal), elements = event.element === null ? Array.from({ length: row.size }, (_, k) => k) : [event.element];
        const ids = elements.map(k => this.system.addFault(number, k, FAULTS.indexOf(event.kind) + 1, event.value, this.kept(event, row)));
        this.active.set(event, ids);
        if (ids.includes(0)) this.problem = "There is no memory for so many faults at a time: at most 128 elements, and 8,192 delayed samples";
      }
    }
  }
  kept(event, row) {
    return event.kind === "delay" ? Math.round(event.value / (row.ticks * this.system.tick)) : event.kind === "freeze" || event.kind === "drop" ? 1 : 0;
  }
  // The events have changed from a point on: what was computed after it is computed again.
  changed(from) {
    this.due = null;
    if (this.earliest !== undefined) { this.earliest = Math.min(this.earliest, from); return; }
    if (from < 0) this.begin();  // a start value was set
    if (from < 0 || from >= this.steps) return;
    const reached = this.steps;
    this.snapshots = this.snapshots.filter(s => s.steps <= from);
    this.seek(this.snapshots.at(-1).steps);
    this.seek(reached);
  }
  // Several changes at once: the past is computed again once.
  together(change) {
    this.earliest = Infinity;
    try { return change(); } finally { const from = this.earliest; this.earliest = undefined; this.changed(from); }
  }
  add(event) {
    event.serial = this.serial++;
    this.events.push(event);
    this.changed(Timeline.acts(event)[0]);
    return event;
  }
  remove(...events) {
    if (!events.length) return;
    this.events = this.events.filter(e => !events.includes(e));
    this.changed(Math.min(...events.map(e => Timeline.acts(e)[0])));
  }
  end(event, until) {
    const from = Math.max(0, Math.min(event.until, until) - 1);
    event.until = until;
    this.changed(from);
  }
  // Set an element from the present point on; at the start, it becomes a start value. Return why not, or "".
  set(name, element, value, more) {
    const refused = this.system.refused(name, element, value);
    if (refused) return refused;
    if (this.steps === 0) {
      this.system.put(name, element, value);
      if (this.earliest === undefined) this.begin(); else this.earliest = -1;
      return "";
    }
    const same = this.events.find(e => !e.kind && e.at === this.steps && e.name === name && e.element === element);
    if (same) { same.value = value; this.due = null; }
    else this.add({ at: this.steps, name, element, value, ...more });
    return "";
  }
  // The value that an input or parameter has in the next step.
  value(name, element) {
    const due = this.events.findLast(e => !e.kind && e.at === this.steps && e.name === name && e.element === element);
    return due ? due.value : this.system.get(name)[element];
  }
  // Add a fault; return why not, or "". `at` is at least 1: the first point that a step reaches.
  fault({ signal, element = null, kind, value = 0, at = this.steps + 1, until = Infinity, ...more }) {
    const found = this.signals.get(signal);
    if (!found) return signal ? `${signal} is no output of this system.` : "A fault needs an output.";
    const { row } = found, place = element === null ? signal : this.system.place(row, element);
    if (element !== null && !(element >= 0 && element < row.size)) return `${place} does not exist: ${signal} has ${row.size} element${row.size > 1 ? "s" : ""}.`;
    if (!FAULTS.includes(kind)) return `${place}: the fault “${kind}” is unknown; expected ${FAULTS.join(", ")}.`;
    if (!Number.isFinite(value)) return `${place}: ${kind} needs a number.`;
    if (kind === "drop" && !(value >= 0 && value <= 1)) return `${place}: drop needs a probability from 0 to 1.`;
    if (/override|bias/.test(kind) && row.type !== "Float64" && !Number.isSafeInteger(value)) return `${place}: ${kind} needs a whole number.`;
    if (kind === "delay") {
      const samples = Math.round(value / (row.ticks * this.system.tick));
      if (samples < 1 || +this.seconds(samples * row.ticks) !== value) return `${place}: delay needs a whole number of the component's steps of ${this.seconds(row.ticks)} s.`;
    }
    if (!(at >= 0 && until > at && Number.isInteger(at))) return `${place}: the fault needs an end after its begin.`;
    this.add({ at, until, signal, element, kind, value, ...more });
    return "";
  }
  // ---- begin again ----
  // From time 0 with the present values as start values, and the faults that are active now.
  restart() {
    this.nextDue(this.steps);
    for (const [event] of this.due.get(this.steps) || []) if (!event.kind) this.system.put(event.name, event.element, event.value);
    const now = this.steps + 1;
    this.events = this.ordered.filter(e => e.kind && !e.pilot && e.at <= now && e.until > now);
    for (const e of this.events) Object.assign(e, { at: 1, until: Infinity });
    this.due = null;
    this.begin();
  }
  // From time 0 with the same start values and events.
  reseed(seed) {
    this.seek(0);
    this.system.seed = seed;
    this.begin();
  }
  // Start values that are not those of the system: [name, element, value].
  get startValues() {
    return this.given.flatMap(row => row.start.map((v, k) => [row.name, k, this.start[row.at + k]]).filter(([, k, v]) => v !== row.start[k]));
  }
  // ---- texts ----
  // Time of a point in decimals, rounded down, so that the first point at or after it is this one.
  seconds(step) {
    const [num, den] = this.system.table.tick.map(BigInt), digits = (BigInt(step) * num * 10n ** 9n / den).toString().padStart(10, "0");
    return `${digits.slice(0, -9)}.${digits.slice(-9)}`.replace(/\.?0+$/, "");
  }
  // A scenario of `uuvsim run`, with the command that gives the bits of this run.
  scenario(file) {
    const { table } = this.system, quoted = JSON.stringify;
    const lines = this.ordered.map(e => {
      const row = e.kind ? this.signals.get(e.signal).row : this.system.rows.get(e.name);
      const place = quoted(e.element === null ? e.signal : this.system.place(row, e.element));
      if (!e.kind) return `  - {at: ${this.seconds(e.at)}, set: ${place}, value: ${row.type === "Boolean" ? !!e.value : decimal(e.value)}}`;
      const until = Number.isFinite(e.until) ? `, until: ${this.seconds(e.until)}` : "";
      return `  - {at: ${this.seconds(e.at)}${until}, signal: ${place}, fault: ${e.kind}, value: ${decimal(e.value)}}`;
    });
    return `# ${this.command(file)}\n# hash ${this.system.hash} after ${this.steps} steps\nname: ${quoted(table.name)}\nevents:${lines.length ? "" : " []"}\n${lines.join("\n")}${lines.length ? "\n" : ""}`;
  }
  command(file) {
    const names = [...new Set(this.startValues.map(([name]) => name))];
    const set = names.map(name => {
      const row = this.system.rows.get(name), values = [...this.start.subarray(row.at, row.at + row.size)].map(v => row.type === "Boolean" ? String(!!v) : decimal(v));
      return ` --set '${name}=${row.shape.length ? nested(values, row.shape) : values[0]}'`;
    });
    const whole = Math.ceil(this.steps * this.system.tick), exact = this.seconds(Math.max(1, this.steps));
    const until = BigInt(Math.round(this.steps)) * BigInt(this.system.table.tick[0]) * 10n ** 9n % BigInt(this.system.table.tick[1]) ? whole : exact;
    const source = this.system.table.source || this.system.table.name;
    return `uuvsim run ${/^[\w./-]+$/.test(source) ? source : `'${source}'`} --seed ${this.system.seed}${set.join("")} --until ${until} --scenario ${file}`;
  }
  // All of it as JSON, for a link; `load` reads it, and returns what it cannot use.
  settings() {
    const compact = ({ serial, ...e }) => ({ ...e, ...(e.until === Infinity ? { until: null } : {}) });
    return { system: this.system.table.name, seed: this.system.seed, start: this.startValues, events: this.ordered.map(compact), steps: this.steps };
  }
  load({ seed, start = [], events = [], steps = 0 }) {
    const refused = [];
    this.events = []; this.due = null;
    if (Number.isSafeInteger(seed) && seed >= 0) this.system.seed = seed;
    for (const row of this.given) this.system.values.set(row.start, row.at);
    for (const [name, element, value] of start) {
      const why = this.system.rows.has(name) ? this.system.refused(name, element, value) : `${name} is no input or parameter of this system.`;
      if (why) refused.push(why); else this.system.put(name, element, value);
    }
    this.begin();
    for (const e of events) {
      const inPlace = !e.kind && this.given.some(row => row.name === e.name);
      const why = e.kind ? this.fault({ ...e, until: e.until ?? Infinity }) : !inPlace ? `${e.name} is no input or parameter of this system.`
        : this.system.refused(e.name, e.element, e.value) || (Number.isSafeInteger(e.at) && e.at >= 0 ? "" : `${e.name} is set at ${e.at}; expected a step.`);
      if (why) refused.push(why); else if (!e.kind) this.add({ ...e });
    }
    this.seek(steps);
    return refused;
  }
}
// A number that YAML 1.1 reads as a number too: 1.0e-7, not 1e-7.
function decimal(x) {
  const text = String(x);
  return /e/.test(text) && !text.includes(".") ? text.replace("e", ".0e") : text;
}
function nested(values, shape) {
  if (shape.length === 1) return `[${values.join(", ")}]`;
  const size = values.length / shape[0];
  return `[${Array.from({ length: shape[0] }, (_, k) => nested(values.slice(k * size, (k + 1) * size), shape.slice(1))).join(", ")}]`;
}
