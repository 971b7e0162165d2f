"use strict";
(function () {
/*MATH*/
/*GL*/
  const card = document.getElementById("scene"), canvas = card.querySelector("canvas");
  const overlay = card.querySelector(".overlay"), ink = overlay.getContext("2d");
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
  if (!gl) {
    card.querySelector(".viewport").textContent = "This browser shows no 3-D scene: it has no WebGL 2, or it is switched off.";
    const controls = card.querySelector(".controls");
    if (controls) controls.style.display = "none";
    return;
  }
  const data = JSON.parse(document.getElementById("scene-data").textContent);
  function bytes(text) {
    const raw = atob(text), b = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) b[i] = raw.charCodeAt(i);
    return b.buffer;
  }
  const floats = t => new Float32Array(bytes(t)), shorts = t => new Int16Array(bytes(t));
  const time = floats(data.time), n = time.length;
  const tri = program(gl, SURFACE), lin = program(gl, LINE);
  const corners = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, corners);
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, -1, 1, -1, 0, 1, 1, 1]), gl.STATIC_DRAW);
  const rgb = c => [1, 3, 5].map(i => parseInt(c.slice(i, i + 2), 16) / 255);
  const mesh = m => surface(gl, tri, floats(m.v), new Uint32Array(bytes(m.f)));
  const hulls = data.hulls.map(m => {
    const corner = Float32Array.from(new Uint16Array(bytes(m.v)), (c, k) => m.low[k % 3] + m.step * c);
    let radius = 0;
    for (let k = 0; k < corner.length; k += 3) radius = Math.max(radius, Math.hypot(corner[k], corner[k + 1], corner[k + 2]));
    return { radius, drawn: surface(gl, tri, corner, new (m.wide ? Uint32Array : Uint16Array)(bytes(m.f)), 0.8) };
  });

  const origin = data.origin;  // positions are relative to it: float32 keeps their digits
  let levels = new Map(), interval = 0;
  function ground(t) {
    const z = shorts(t.z), [rows, columns] = t.shape, v = new Float32Array(3 * z.length), f = [];
    interval = nice(t.depths[1] - t.depths[0], 8);
    for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
      const k = i * columns + j;
      v.set([t.north[i] - origin[0], t.east[j] - origin[1], t.low + t.step * z[k]], 3 * k);
      if (!i || !j) continue;
      const a = k - columns - 1, b = k - 1, d = k - columns;
      if ([a, b, k, d].every(p => z[p] > -32768)) f.push(a, k, b, a, d, k);
    }
    levels = contours(v, f, interval);
    return surface(gl, tri, v, new Uint32Array(f));
  }
  const terrain = data.terrain && ground(data.terrain);
  const isolines = [...levels].map(([level, points]) => ({ level, points, ...line(gl, lin, corners, new Float32Array(points), false) }));
  card.querySelectorAll(".interval").forEach(e => { e.textContent = interval ? `contours every ${+interval.toPrecision(3)} m` : ""; });
  const solids = data.solids.map(s => ({ ...mesh(s), colour: rgb(s.colour), alpha: s.alpha }));
  const lines = data.lines.map(l => {
    const points = floats(l.points);
    return { ...line(gl, lin, corners, points, true), points, mark: l.mark && new Path2D(l.mark), every: l.every, css: l.colour, colour: rgb(l.colour), width: l.width };
  });
  const bodies = data.bodies.map(b => {
    const p = floats(b.p), arrows = b.arrows && {
      r: b.arrows.r, e: b.arrows.e, v: data.live ? new Float32Array(b.arrows.r.length) : shorts(b.arrows.v), scale: data.live ? 32767 : b.arrows.scale,
    };
    const points = arrows && new Float32Array(18 * arrows.r.length);
    const { radius, drawn: hull } = hulls[b.hull];
    return { name: b.name, p, q: b.q && shorts(b.q), size: b.size, radius, hull, colour: rgb(b.colour), css: b.colour, arrows, points,
      drawn: points && line(gl, lin, corners, points, false) };
  });

  // Tracks of a live scene grow: each has room for POINTS points, and keeps every second when it is full.
  const POINTS = 6000, tracks = !data.live ? [] : bodies.map(b => {
    const points = new Float32Array(3 * POINTS);
    return { ...line(gl, lin, corners, points, true), count: 0, points, n: 0, every: 1, seen: 0, colour: b.colour };
  });
  const [low, high] = data.extent, middle = low.map((v, i) => (v + high[i]) / 2);
  const reach = Math.hypot(...sub(high, low)) || 1;
  const spacing = nice(Math.max(high[0] - low[0], high[1] - low[1]), 5);
  const ticks = (a, b, s) => Array.from({ length: Math.max(0, Math.floor(b / s + 1e-9) - Math.ceil(a / s - 1e-9)) + 1 }, (_, k) => (Math.ceil(a / s - 1e-9) + k) * s);
  // Axes along three edges of the box around the motion: from its corner in the south-west, below.
  const top = Math.min(0, low[2]), axes = [
    { name: "north [m]", end: [high[0], low[1], high[2]], to: v => [v, low[1], high[2]], at: ticks(low[0] + origin[0], high[0] + origin[0], spacing), shift: origin[0] },
    { name: "east [m]", end: [low[0], high[1], high[2]], to: v => [low[0], v, high[2]], at: ticks(low[1] + origin[1], high[1] + origin[1], spacing), shift: origin[1] },
    { name: "depth [m]", end: [low[0], low[1], top], to: v => [low[0], low[1], v], at: ticks(top, high[2], nice(Math.max(high[2] - top, 1e-3), 3)), shift: 0 },
  ];
  const corner = [low[0], low[1], high[2]];
  const frame = line(gl, lin, corners, new Float32Array(axes.flatMap(a => [...corner, ...a.end])), false);
  const camera = { at: middle, turn: -2.6, lift: 0.55, away: 1.3 * reach };
  let t = time[0], playing = null, follow = false, asked = false;
  const slider = card.querySelector("input[type=range]"), go = card.querySelector(".go");
  const clock = card.querySelector(".clock"), speed = card.querySelector("select"), whom = card.querySelector(".follow");
  const wet = card.querySelector(".wet"), net = card.querySelector(".net");
  wet.onchange = net.onchange = () => again();
  // Colour of water at a depth [m]: its light fades with the attenuation of daylight, red first.
  const murk = z => [[0.1, 0.3], [0.42, 0.075], [0.5, 0.06]].map(([c, K], i) => 0.45 * c + 0.55 * c * Math.exp(-K * Math.max(0, z)));

  function nearest() {
    let a = 0, b = n - 1;
    while (b - a > 1) { const m = (a + b) >> 1; if (time[m] <= t) a = m; else b = m; }
    const part = b > a ? Math.min(1, Math.max(0, (t - time[a]) / (time[b] - time[a] || 1))) : 0;
    return [a, b, part];
  }
  function where(body, [a, b, part]) {
    const p = [0, 1, 2].map(i => body.p[3 * a + i] + part * (body.p[3 * b + i] - body.p[3 * a + i]));
    if (!body.q) return [p, [1, 0, 0, 0]];
    const q = k => [0, 1, 2, 3].map(i => body.q[4 * k + i] / 32767);
    return [p, between(q(a), q(b), part)];
  }
  function bind(p, view, model, colour, alpha, water) {
    gl.useProgram(p.p);
    gl.uniformMatrix4fv(p.u.view, false, view); gl.uniformMatrix4fv(p.u.model, false, model);
    gl.uniform3fv(p.u.colour, colour); gl.uniform3fv(p.u.water, water);
    gl.uniform1f(p.u.fade, wet.checked ? 3.5 * camera.away : 7 * Math.max(reach, camera.away)); gl.uniform1f(p.u.alpha, alpha);
  }
  function draw() {
    asked = false;
    const box = canvas.getBoundingClientRect(), ratio = Math.min(2, window.devicePixelRatio || 1);
    const w = Math.max(1, Math.round(box.width * ratio)), h = Math.max(1, Math.round(box.height * ratio));
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const probe = getComputedStyle(card.querySelector(".viewport")).backgroundColor.match(/[\d.]+/g).map(Number);
    const moment = nearest();
    if (follow && bodies.length) camera.at = where(bodies[0], moment)[0].map((v, i) => isFinite(v) ? v : camera.at[i]);
    const c = Math.cos(camera.lift), to = [c * Math.cos(camera.turn), c * Math.sin(camera.turn), -Math.sin(camera.lift)];
    const hulls = bodies.map(b => [where(b, moment)[0], 1.15 * b.radius]).filter(([p]) => p.every(isFinite));
    const eye = outside(camera.at.map((v, i) => v + camera.away * to[i]), to, hulls);
    camera.away = Math.hypot(...sub(eye, camera.at)); camera.eye = eye; camera.hulls = hulls;
    const water = wet.checked ? murk(eye[2]) : probe.slice(0, 3).map(v => v / 255);
    const near = Math.min(0.01 * camera.away, ...hulls.map(([p, r]) => Math.max(0.5 * (Math.hypot(...sub(eye, p)) - 0.87 * r), 1e-3 * r)));
    const opening = 0.42 * Math.max(1, 1.3 * h / w);
    const view = times(perspective(2 * Math.atan(opening), w / h, near, 30 * Math.max(reach, camera.away)), lookAt(eye, camera.at, [0, 0, -1]));
    gl.viewport(0, 0, w, h); gl.clearColor(...water, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT); gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
    const fill = (s, model, colour, alpha, depths) => {
      bind(tri, view, model, colour, alpha, water);
      gl.uniform3fv(tri.u.eye, eye); gl.uniform2fv(tri.u.depths, depths || [0, 0]);
      gl.uniform1f(tri.u.wet, +wet.checked); gl.uniform1f(tri.u.net, +net.checked); gl.uniform1f(tri.u.time, t);
      gl.bindVertexArray(s.vao); gl.drawArrays(gl.TRIANGLES, 0, s.count);
    };
    const stroke = (l, model, colour, width, alpha) => {
      bind(lin, view, model, colour, alpha, water);
      gl.uniform2fv(lin.u.screen, [w, h]); gl.uniform1f(lin.u.width, width * ratio);
      gl.bindVertexArray(l.vao); gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, l.count);
    };
    if (terrain) fill(terrain, still(), [0, 0, 0], 1, data.terrain.depths);
    for (const s of solids) if (s.alpha === 1) fill(s, still(), s.colour, 1);
    for (const l of isolines) stroke(l, still(), [0.08, 0.16, 0.26], 0.9, 1);
    for (const l of lines) stroke(l, still(), l.colour, l.width, 1);
    for (const l of tracks) {
      if (l.fresh) {
        gl.bindBuffer(gl.ARRAY_BUFFER, l.buffer); gl.bufferSubData(gl.ARRAY_BUFFER, 0, l.points.subarray(0, 3 * l.n));
        l.count = l.n - 1; l.fresh = false;
      }
      if (l.count > 0) stroke(l, still(), l.colour, 1.6, 1);
    }
    const css = getComputedStyle(card), muted = css.getPropertyValue("--muted").trim();
    stroke(frame, still(), rgb(muted), 1, 1);
    for (const b of bodies) {
      const [p, q] = where(b, moment);
      if (!p.every(isFinite)) continue;
      const model = pose(p, q);
      fill(b.hull, model, b.colour, 1);
      if (!b.arrows) continue;
      const k = moment[2] < 0.5 ? moment[0] : moment[1], m = b.arrows.r.length;
      for (let i = 0; i < m; i++) {
        const r = b.arrows.r[i], e = b.arrows.e[i], v = b.arrows.v[k * m + i] / 32767 * b.arrows.scale;
        const tip = r.map((x, j) => x + v * e[j]), side = unit(cross(e, Math.abs(e[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1]));
        const back = s => tip.map((x, j) => x - 0.25 * v * e[j] + s * 0.12 * v * side[j]);
        b.points.set([...r, ...tip, ...back(1), ...tip, ...back(-1), ...tip], 18 * i);
      }
      gl.bindBuffer(gl.ARRAY_BUFFER, b.drawn.buffer); gl.bufferSubData(gl.ARRAY_BUFFER, 0, b.points);
      gl.disable(gl.DEPTH_TEST);  // thrusters often sit within the hull
      stroke(b.drawn, model, rgb(data.arrow), 2.5, 1);
      gl.enable(gl.DEPTH_TEST);
    }
    gl.enable(gl.BLEND); gl.depthMask(false); gl.enable(gl.CULL_FACE);  // a basin is seen from within
    for (const s of solids) if (s.alpha < 1) fill(s, still(), s.colour, s.alpha);
    gl.disable(gl.BLEND); gl.disable(gl.CULL_FACE); gl.depthMask(true); gl.bindVertexArray(null);
    label(view, box, ratio, opening, css, moment);
    if (slider) { slider.value = t; clock.textContent = "t = " + t.toFixed(1) + " s"; }
  }
  // Texts and marks over the scene: ticks of the axes, depths of contours, marks of lines, a scale.
  function label(view, box, ratio, opening, css, moment) {
    const w = box.width, h = box.height;
    overlay.width = canvas.width; overlay.height = canvas.height;
    ink.setTransform(ratio, 0, 0, ratio, 0, 0);
    ink.font = "11px system-ui, sans-serif"; ink.textAlign = "center"; ink.textBaseline = "middle"; ink.lineJoin = "round";
    const text = (words, p, colour) => {
      if (!p || p[0] < 0 || p[0] > w || p[1] < 0 || p[1] > h) return;
      ink.lineWidth = 3; ink.strokeStyle = css.getPropertyValue("--water"); ink.strokeText(words, ...p);
      ink.fillStyle = colour; ink.fillText(words, ...p);
    };
    const muted = css.getPropertyValue("--ink"), minus = v => String(+v.toPrecision(6)).replace("-", "−");
    for (const axis of axes) {
      const end = project(view, axis.end, w, h), from = project(view, corner, w, h);
      if (!end || !from) continue;
      const length = Math.hypot(end[0] - from[0], end[1] - from[1]);
      if (length < 40) continue;  // seen from its end
      let last = null;
      for (const v of axis.at) {
        const p = project(view, axis.to(v - axis.shift), w, h);
        if (!p || (last && Math.hypot(p[0] - last[0], p[1] - last[1]) < 26)) continue;
        ink.fillStyle = muted; ink.fillRect(p[0] - 1.5, p[1] - 1.5, 3, 3);
        text(minus(v), [p[0], p[1] + 11], muted); last = p;
      }
      text(axis.name, [end[0] + 26 * (end[0] - from[0]) / length, end[1] + 22 * (end[1] - from[1]) / length - 4], muted);
    }
    for (const { level, points } of isolines) {
      const k = 3 * Math.floor(points.length / 6);
      text(minus(level), project(view, points.slice(k, k + 3), w, h), muted);
    }
    lines.forEach((l, number) => {
      if (!l.mark) return;
      const n = l.points.length / 3, every = l.every || Math.max(1, Math.floor(n / 12));
      for (let k = l.every ? 0 : Math.floor(every * ((0.25 + 0.4 * number) % 1)); k < n; k += every) {
        const p = project(view, l.points.subarray(3 * k, 3 * k + 3), w, h);
        if (!p) continue;
        ink.save(); ink.translate(...p); ink.scale(0.9, 0.9); ink.lineWidth = 1.2;
        ink.strokeStyle = ink.fillStyle = l.css; ink.fill(l.mark); ink.stroke(l.mark); ink.restore();
      }
    });
    if (bodies.length > 1) for (const b of bodies) {
      const [at] = where(b, moment);
      if (at.every(isFinite)) { const p = project(view, at, w, h); if (p) text(b.name, [p[0], p[1] - 14], b.css); }
    }
    const metre = h / (2 * camera.away * opening), size = nice(90 / metre, 1), wide = size * metre;
    ink.fillStyle = muted; ink.fillRect(14, h - 16, wide, 2); ink.fillRect(14, h - 20, 1.5, 6); ink.fillRect(12.5 + wide, h - 20, 1.5, 6);
    text(`${minus(size)} m at the centre`, [14 + Math.max(wide / 2, 46), h - 28], muted);
  }
  function again() { if (!asked) { asked = true; requestAnimationFrame(draw); } }
  function stop() { playing = null; go.textContent = "play"; }
  function step(now) {
    if (!playing) return;
    t += (now - playing) / 1000 * +speed.value; playing = now;
    if (t >= time[n - 1]) { t = time[n - 1]; stop(); }
    again();
    if (playing) requestAnimationFrame(step);
  }
  if (go) go.onclick = () => {
    if (playing) { stop(); return; }
    if (t >= time[n - 1]) t = time[0];
    go.textContent = "pause"; playing = performance.now(); requestAnimationFrame(step);
  };
  if (slider) {
    slider.min = time[0]; slider.max = time[n - 1]; slider.step = (time[n - 1] - time[0]) / 2000 || 1;
    slider.oninput = () => { stop(); t = +slider.value; again(); };
  }
  whom.onchange = () => {
    follow = whom.checked;
    if (follow && bodies.length) camera.away = 7 * bodies[0].size;
    else { camera.at = middle; camera.away = 1.3 * reach; }
    again();
  };
  canvas.onpointerdown = e => { canvas.setPointerCapture(e.pointerId); canvas.focus({ preventScroll: true }); };
  canvas.onpointermove = e => {
    if (!e.buttons) return;
    if (e.shiftKey || e.buttons === 2) {
      const m = camera.away / canvas.clientHeight, [c, s] = [Math.cos(camera.turn), Math.sin(camera.turn)];
      const right = e.movementX * m, up = e.movementY * m;
      camera.at = [camera.at[0] + s * right - c * up, camera.at[1] - c * right - s * up, camera.at[2]];
      follow = whom.checked = false;
    } else {
      camera.turn += 0.008 * e.movementX;
      camera.lift = Math.min(1.56, Math.max(-1.2, camera.lift + 0.008 * e.movementY));
    }
    again();
  };
  canvas.oncontextmenu = e => e.preventDefault();
  function zoom(by) { camera.away = Math.min(20 * reach, Math.max(0.002 * reach, camera.away * by)); again(); }
  // Until somebody has clicked into it, the wheel turns the page, not the scene.
  canvas.addEventListener("wheel", e => {
    if (document.activeElement !== canvas && !e.ctrlKey) return;
    e.preventDefault(); zoom(Math.exp(0.0012 * e.deltaY));
  }, { passive: false });
  canvas.onkeydown = e => {
    const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
    if (keys) { camera.turn += keys[0]; camera.lift = Math.min(1.56, Math.max(-1.2, camera.lift + keys[1])); again(); }
    else if (e.key === "+") zoom(0.9); else if (e.key === "-") zoom(1.1); else if (e.key === " " && go) go.click(); else return;
    e.preventDefault();
  };
  window.addEventListener("resize", again);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  new MutationObserver(again).observe(document.documentElement, { attributes: true });
  // Of a live scene: the pose of a body, p in n [m] and q, and the lengths of its arrows [m].
  function move(number, p, q, lengths) {
    const body = bodies[number], track = tracks[number];
    p.forEach((v, i) => { body.p[i] = v - origin[i]; });
    if (q && body.q) q.forEach((v, i) => { body.q[i] = Math.round(32767 * v); });
    if (lengths && body.arrows) lengths.forEach((v, i) => { body.arrows.v[i] = v; });
    if (track.seen++ % track.every === 0) {
      if (track.n === POINTS) {
        for (let k = 0; k < POINTS / 2; k++) track.points.copyWithin(3 * k, 6 * k, 6 * k + 3);
        track.n = POINTS / 2; track.every *= 2;
      }
      track.points.set(body.p, 3 * track.n++);
      track.fresh = true;
    }
    again();
  }
  const clear = () => { for (const l of tracks) { l.n = l.count = l.seen = 0; l.every = 1; } again(); };
  // Other points of a line, in n [m].
  function path(number, points) {
    if (!lines[number]) return;
    gl.deleteVertexArray(lines[number].vao); gl.deleteBuffer(lines[number].buffer);
    const moved = new Float32Array(points.flatMap(p => p.map((v, i) => v - origin[i])));
    Object.assign(lines[number], line(gl, lin, corners, moved, true), { points: moved });
    again();
  }
  window.uuvsimScene = { camera, zoom, move, clear, path, at: s => { if (!playing) { t = s; again(); } } };
  if (data.live) { whom.checked = true; whom.onchange(); }
  draw();
})();
