// Faults and events of a run: the form that adds faults, their list, the link, and the scenario to download.
function eventsCard(page) {
  const { find, make, line, shown, notice, told } = page, card = find("#events"), list = find("#happens");
  const pad = k => k.toString().padStart(2, "0");
  // ---- add a fault ----
  const signal = find("#fault-signal"), kind = find("#fault-kind"), value = find("#fault-value"), unit = find("#fault-unit"), lasts = find("#fault-lasts");
  const unitsOf = (row, element) => row.units.length < 2 ? row.units : element === null ? [...new Set(row.units)] : [row.units[element]];
  const read = () => {
    const [, name, k] = signal.value.trim().match(/^(.*?)(?:\[(\d+)\])?$/);
    return { name, element: k ? k - 1 : null, row: (line.signals.get(name) || {}).row };
  };
  function units() {
    const { row, element } = read(), of = row && unitsOf(row, element).filter(u => u !== "1").join(", ");
    value.disabled = kind.value === "freeze";
    unit.textContent = { override: of, bias: of, scale: "factor", delay: "s", drop: "probability", freeze: "" }[kind.value] || "";
  }
  signal.oninput = kind.onchange = units;
  signal.placeholder = line.system.table.output[0].name;
  find("#fault-add").onclick = () => {
    const { name, element } = read(), span = lasts.value === "" ? Infinity : Math.round(+lasts.value / line.system.tick);
    const at = line.steps + 1, number = value.value === "" ? (kind.value === "freeze" ? 0 : NaN) : +value.value;
    const refused = !(span >= 1) ? "A fault lasts at least one step." : line.fault({ signal: name, element, kind: kind.value, value: number, at, until: at + span });
    notice(refused || line.problem);
    if (!refused) page.refresh();
  };
  // ---- the list ----
  const time = point => `${shown(point * line.system.tick)} s`;
  function text(e) {
    const row = e.kind ? line.signals.get(e.signal).row : line.system.rows.get(e.name);
    const place = e.element === null ? e.signal : line.system.place(row, e.element), number = shown(e.value);
    const values = () => unitsOf(row, e.element).map(u => u && u !== "1" ? `${number} ${u}` : number).join(", ") || number;
    if (!e.kind) return `${place} = ${values()}`;
    return `${place}: ${e.kind}${e.kind === "freeze" ? "" : ` ${/override|bias/.test(e.kind) ? values() : e.kind === "delay" ? `${number} s` : number}`}`;
  }
  const MOST = 200;
  function row(at, words, buttons, isNow) {
    return make("div", { className: `event${isNow ? " now" : ""}` }, make("span", { textContent: at }), make("span", { textContent: words }), ...buttons);
  }
  const button = (label, title, onclick) => make("button", { type: "button", textContent: label, title, onclick });
  function show() {
    const events = line.ordered, own = events.filter(e => !e.pilot), byHand = events.filter(e => e.pilot), now = line.steps + 1;
    const rows = own.slice(-MOST).map(e => {
      const active = e.kind && e.at <= now && e.until > now, buttons = [];
      if (active && e.until === Infinity) buttons.push(button("end", "end this fault now", () => { line.end(e, now); page.refresh(); }));
      buttons.push(button("×", "remove: the run so far is computed again", () => { line.remove(e); page.refresh(); }));
      return row(e.kind ? `${time(e.at)} – ${e.until === Infinity ? "" : time(e.until)}` : time(e.at), text(e), buttons, active);
    });
    if (byHand.length) rows.push(row(`${time(byHand[0].at)} – ${time(byHand.at(-1).at)}`, `steered by hand: ${byHand.length} events`, [
      button("×", "remove: the run so far is computed again", () => { line.remove(...byHand); page.refresh(); })]));
    if (own.length > MOST) rows.unshift(make("p", { textContent: `The first ${own.length - MOST} events are not listed.` }));
    list.replaceChildren(...rows);
    find("#replay").hidden = !events.length;
    find("#restart").textContent = events.length ? "restart with present values" : "restart";
    find("#no-events").hidden = events.length > 0;
  }
  // ---- the scenario, and the link ----
  find("#download").onclick = () => {
    const file = `${line.system.table.name}_scenario.yaml`;
    const url = URL.createObjectURL(new Blob([line.scenario(file)], { type: "text/yaml" }));
    make("a", { href: url, download: file }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60e3);
    told(`The same bits outside of this page: ${line.command(file)}`);
  };
  find("#link").onclick = async () => {
    const link = await settingsText(page.settings());
    history.replaceState(null, "", `#link=${link}`);
    const address = location.href, long = address.length > 8000 ? ` Some programs cut so long a link${page.data.named ? ": download the scenario instead" : ""}.` : "";
    const tell = place => told(`The link has ${address.length.toLocaleString("en")} characters and all settings up to this point. ${place}${long}`);
    tell("It is in the address of this page."); // a browser may ask before it copies, and need not answer
    try { await navigator.clipboard.writeText(address); tell("It was copied."); } catch { /* not allowed here */ }
  };
  units();
  return { show };
}
// Settings as a text for the fragment of a link: JSON, packed by zlib, whose check sum finds damage.
async function through(stream, bytes) {
  const blob = await new Response(new Blob([bytes]).stream().pipeThrough(stream)).arrayBuffer();
  return new Uint8Array(blob);
}
async function settingsText(settings) {
  const bytes = await through(new CompressionStream("deflate"), new TextEncoder().encode(JSON.stringify(settings)));
  let text = "";
  for (const b of bytes) text += String.fromCharCode(b);
  return btoa(text).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
}
async function settingsOf(text) {
  const raw = atob(text.replace(/-/g, "+").replace(/_/g, "/"));
  const bytes = await through(new DecompressionStream("deflate"), Uint8Array.from(raw, c => c.charCodeAt(0)));
  return JSON.parse(new TextDecoder().decode(bytes));
}
