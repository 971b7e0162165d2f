// Steering by keyboard, gamepad or the buttons of the page. The axes are those of bridge/http (pilot.html,
// keyboard.py): 20 times a simulated second they become set-points, which are events of the run.
function steeringCard(page, targets) {
  const { find, make, line, notice, shown } = page, NAMES = ["surge", "sway", "heave", "yaw"];
  const KEYS = { KeyW: ["surge", 1], KeyS: ["surge", -1], KeyD: ["yaw", 1], KeyA: ["yaw", -1], ArrowRight: ["yaw", 1], ArrowLeft: ["yaw", -1],
    KeyE: ["sway", 1], KeyQ: ["sway", -1], ArrowDown: ["heave", 1], ArrowUp: ["heave", -1], KeyF: ["heave", 1], KeyR: ["heave", -1] };
  const LIMITS = { surge: 0.5, sway: 0.3, heave: 0.3, yaw: 0.6, a: 0.5, r_dot: 1, lead: 1, lead_psi: 0.6, k_u: 2 };  // of Piloted
  const HELM = { speed: 0.3, yaw: 1.5, a: 0.4, k_u: 2 };  // of ManualOverlay
  const FULL = [40, 40, 40, 10];  // N, N, N, N.m: of a wrench
  const held = new Set(), { tick } = line.system, every = Math.max(1, Math.round(0.05 / tick)), dt = every * tick;
  let on = false, target = targets[0], pose = null, velocity = [0, 0, 0, 0], moved = false, open = new Map();
  const within = (v, most) => Math.max(-most, Math.min(most, v)), wrapped = a => a - 2 * Math.PI * Math.floor((a + Math.PI) / (2 * Math.PI));
  const stick = (pad, i) => { const v = pad.axes[i] || 0; return Math.abs(v) < 0.1 ? 0 : Math.sign(v) * (Math.abs(v) - 0.1) / 0.9; };
  const pad = () => [...(navigator.getGamepads ? navigator.getGamepads() : [])].find(p => p && p.connected);
  function axes() {
    const a = { surge: 0, sway: 0, heave: 0, yaw: 0 }, slow = held.has("ShiftLeft") || held.has("ShiftRight") ? 0.3 : 1, found = pad();
    for (const k of held) if (KEYS[k]) a[KEYS[k][0]] += KEYS[k][1] * slow;
    if (found) { a.surge -= stick(found, 1); a.sway += stick(found, 0); a.yaw += stick(found, 2); a.heave += stick(found, 3); }
    return NAMES.map(n => within(a[n], 1));
  }
  const read = name => line.system.get(name);
  // What the axes command at this point: by signal or input, the value of each element.
  const COMMANDS = {
    guidance(s) {
      const eta = read(target.eta), most = [LIMITS.surge, LIMITS.sway, LIMITS.heave, LIMITS.yaw];
      if (!pose) pose = [eta[0], eta[1], eta[2], eta[5]];
      velocity = velocity.map((v, i) => v + within(s[i] * most[i] - v, (i < 3 ? LIMITS.a : LIMITS.r_dot) * dt));
      const [u, v, w, r] = velocity, psi = pose[3], [c, k] = [Math.cos(psi), Math.sin(psi)];
      const to = [pose[0] + dt * (c * u - k * v), pose[1] + dt * (k * u + c * v), pose[2] + dt * w];
      const away = Math.hypot(...to.map((x, i) => x - eta[i])), share = away > 0 ? Math.min(1, LIMITS.lead / away) : 1;
      pose = [...to.map((x, i) => eta[i] + share * (x - eta[i])), wrapped(eta[5] + within(wrapped(psi + dt * r - eta[5]), LIMITS.lead_psi))];
      return { [`${target.path}.eta_d`]: [...pose.slice(0, 3), 0, 0, pose[3]], [`${target.path}.nu_d`]: [u, v, w, 0, 0, r] };
    },
    helm(s) {
      velocity = velocity.map((v, i) => i % 3 ? 0 : v + within(s[i] * (i ? LIMITS.yaw : LIMITS.surge) - v, (i ? LIMITS.r_dot : LIMITS.a) * dt));
      return { [`${target.path}.a`]: [within(LIMITS.k_u * (velocity[0] - read(target.nu)[0]), LIMITS.a)], [`${target.path}.omega`]: [velocity[3]] };
    },
    pilot(s) {
      const u = read(`${target.path}.nu_d`)[0];
      moved = s[0] !== 0 || (moved && Math.abs(u) > 1e-3);
      return { [`${target.path}.a`]: [moved ? within(HELM.k_u * (s[0] * HELM.speed - u), HELM.a) : 0], [`${target.path}.omega`]: [s[3] * HELM.yaw] };
    },
    wrench(s) { return { [target.path]: [...s.slice(0, 3).map((v, i) => v * FULL[i]), 0, 0, s[3] * FULL[3]] }; },
  };
  const MOVES = {
    guidance: () => `${target.path}.eta_d and ${target.path}.nu_d, as overridden signals. The axes are desired velocities: ${LIMITS.surge} m/s ahead, ${LIMITS.sway} m/s sideways, ${LIMITS.heave} m/s vertically, ${LIMITS.yaw} rad/s. The desired pose is at most ${LIMITS.lead} m ahead of the vehicle`,
    helm: () => `${target.path}.a and ${target.path}.omega, as overridden signals: desired surge acceleration, at most ${LIMITS.a} m/s², and yaw rate, at most ${LIMITS.yaw} rad/s`,
    pilot: () => `the inputs ${target.path}.a and ${target.path}.omega: desired surge acceleration, at most ${HELM.a} m/s², and yaw rate, at most ${HELM.yaw} rad/s`,
    wrench: () => `the input ${target.path}: ${FULL[0]} N along each axis, and ${FULL[3]} N.m about the vertical axis`,
  };
  // Before a step: new set-points, of which only those that change are events.
  function beat() {
    if (!on || line.steps % every) return;
    const s = axes();
    bars(s);
    line.together(() => {
      for (const [name, values] of Object.entries(COMMANDS[target.kind](s))) values.forEach((value, k) => {
        if (target.kind === "pilot" || target.kind === "wrench") {
          if (line.value(name, k) !== value) line.set(name, k, value, { pilot: true });
          return;
        }
        const key = `${name}[${k}]`, last = open.get(key), row = line.signals.get(name).row;
        if (last && last.value === value) return;
        if (last) line.end(last, line.steps + 1);
        line.fault({ signal: name, element: row.shape.length ? k : null, kind: "override", value, at: line.steps + 1, pilot: true });
        open.set(key, line.events.at(-1));
      });
    });
  }
  function release() {
    if (!on) return;
    on = false; held.clear(); bars([0, 0, 0, 0]);
    line.together(() => {
      for (const e of open.values()) if (e.until > line.steps + 1) line.end(e, line.steps + 1);
      if (target.kind === "pilot") for (const n of ["a", "omega"]) line.set(`${target.path}.${n}`, 0, 0, { pilot: true });
      if (target.kind === "wrench") read(target.path).forEach((_, k) => line.set(target.path, k, 0, { pilot: true }));
    });
    open.clear();
    state(); page.refresh();
  }
  function take() {
    on = true; pose = null; velocity = [0, 0, 0, 0]; moved = false; open = new Map();
    line.together(() => {  // what was steered later in an earlier try
      const later = line.events.filter(e => e.pilot && e.at > line.steps);
      for (const e of line.events) if (e.pilot && e.kind && e.at <= line.steps && e.until > line.steps + 1) line.end(e, line.steps + 1);
      line.remove(...later);
    });
    state(); page.refresh();
    if (!page.running()) page.run();
  }
  function state() {
    find("#take").textContent = on ? "let go" : "take the controls";
    find("#take").setAttribute("aria-pressed", on);
    const found = pad();
    find("#moves").textContent = `They move ${MOVES[target.kind]()}. ${found ? `Gamepad: ${found.id}.` : "A gamepad is found when one of its buttons is pressed."}`;
  }
  const marks = NAMES.map(name => {
    const mark = make("i", {}), text = make("span", {});
    find("#axes").append(make("span", { textContent: name }), make("div", { className: "bar" }, mark), text);
    return [mark, text];
  });
  function bars(s) {
    s.forEach((v, i) => {
      const [mark, text] = marks[i];
      mark.style.left = `${v < 0 ? 50 + 50 * v : 50}%`; mark.style.width = `${50 * Math.abs(v)}%`; text.textContent = shown(+v.toFixed(2));
    });
  }
  const whom = find("#whom");
  whom.append(...targets.map((t, k) => make("option", { value: k, textContent: t.path })));
  whom.parentElement.hidden = targets.length < 2;
  whom.onchange = () => { release(); target = targets[+whom.value]; state(); };
  find("#take").onclick = () => { find("#take").blur(); if (on) release(); else take(); };
  const typing = e => /INPUT|SELECT|TEXTAREA/.test(e.target.tagName);
  document.addEventListener("keydown", e => { if (on && !typing(e) && (KEYS[e.code] || e.code.startsWith("Shift"))) { held.add(e.code); if (!e.code.startsWith("Shift")) e.preventDefault(); } });
  document.addEventListener("keyup", e => held.delete(e.code));
  window.addEventListener("blur", () => held.clear());
  window.addEventListener("gamepadconnected", state);
  window.addEventListener("gamepaddisconnected", state);
  for (const b of document.querySelectorAll("#pads button")) {
    b.onpointerdown = e => { e.preventDefault(); held.add(b.dataset.key); };
    b.onpointerup = b.onpointerleave = b.onpointercancel = () => held.delete(b.dataset.key);
  }
  bars([0, 0, 0, 0]); state();
  return { beat, release, every, get on() { return on; } };
}
