"use strict";
// A system of declarations in WebAssembly, without any document: pages and node use it alike.
// `table` has the variables with their places in the block of values (module.py), `bytes` the module.
class System {
  constructor(table, bytes) {
    this.table = table;
    this.tick = table.tick[0] / table.tick[1];
    this.c = new WebAssembly.Instance(new WebAssembly.Module(bytes), {}).exports;
    this.c._initialize();
    this.block = this.c.uuv_page_open();
    if (!this.block) throw new Error("There is not enough memory for this system.");
    this.rows = new Map([...table.input, ...table.parameter, ...table.output].map(row => [row.name, row]));
    this.columns = table.output.flatMap(row => Array.from({ length: row.size }, (_, k) => row.at + k));
    this.begin();
  }
  // The block of values; the memory moves when it grows, so nobody keeps this array.
  get values() { return new Float64Array(this.c.memory.buffer, this.block, this.table.size); }
  get time() { return this.steps * this.tick; }
  get hash() { return BigInt.asUintN(64, this.c.uuv_page_hash()).toString(16).padStart(16, "0"); }
  get failure() {
    const bytes = new Uint8Array(this.c.memory.buffer, this.c.uuv_page_failure()), end = bytes.indexOf(0);
    return new TextDecoder().decode(bytes.slice(0, end));
  }
  // Begin at time 0 from the present inputs and parameters.
  begin() { this.steps = 0; this.c.uuv_page_begin(); }
  // Make up to n communication steps; return how many were made.
  run(n) {
    const made = this.c.uuv_page_run(n);
    this.steps += made;
    return made;
  }
  get(name) {
    const row = this.rows.get(name);
    return this.values.slice(row.at, row.at + row.size);
  }
  // The name of an element: "allocation.health[3]", "guidance.waypoints[2,1]".
  place(row, element) {
    const index = [];
    for (let d = row.shape.length - 1, rest = element; d >= 0; d--) { index.unshift((d ? rest % row.shape[d] : rest) + 1); rest = Math.floor(rest / row.shape[d]); }
    return index.length ? `${row.name}[${index.join(",")}]` : row.name;
  }
  // Why an element of an input or a parameter cannot have a value, or "".
  refused(name, element, value) {
    const row = this.rows.get(name), place = this.place(row, element);
    if (!(element in row.start)) return `${place} does not exist.`;
    if (!Number.isFinite(value)) return `${place} needs a number.`;
    if (row.type !== "Float64" && value !== Math.round(value)) return `${place} needs a whole number.`;
    if (!row.soft && row.min !== null && value < row.min) return `${place} is at least ${row.min}.`;
    if (!row.soft && row.max !== null && value > row.max) return `${place} is at most ${row.max}.`;
    return "";
  }
  put(name, element, value) { this.values[this.rows.get(name).at + element] = value; }
  // Set an element of an input or a parameter; return why not, or "".
  set(name, element, value) {
    const refused = this.refused(name, element, value);
    if (!refused) this.put(name, element, value);
    return refused;
  }
  // Make element k of an output (by its number) faulty from now on; return the fault's number, or 0.
  addFault(output, k, kind, value, kept) { return this.c.uuv_page_add_fault(output, k, kind, value, kept); }
  clearFault(id) { this.c.uuv_page_clear_fault(id); }
  get seed() { return this.values[this.table.seed]; }
  set seed(value) { this.values[this.table.seed] = value; }
  // All outputs now, one number an element, in the order of the table.
  outputs() { const values = this.values; return this.columns.map(k => values[k]); }
  save() {
    this.c.uuv_page_save();
    return { steps: this.steps, bytes: new Uint8Array(this.c.memory.buffer, this.c.uuv_page_state(), this.c.uuv_page_state_size()).slice() };
  }
  restore(kept) {
    new Uint8Array(this.c.memory.buffer, this.c.uuv_page_state()).set(kept.bytes);
    this.c.uuv_page_restore();
    this.steps = kept.steps;
  }
}
