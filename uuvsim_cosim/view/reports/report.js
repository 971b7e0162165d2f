"use strict";
(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  function floats(text) {
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Float32Array(bytes.buffer);
  }
  const time = floats(data.time);
  const series = data.series.map(s => ({ values: floats(s.v), digits: s.d }));
  const outputs = [...document.querySelectorAll("[data-s]")];
  const panels = [...document.querySelectorAll("svg[data-x0]")].map(svg => ({
    svg, x0: +svg.dataset.x0, x1: +svg.dataset.x1, width: svg.viewBox.baseVal.width,
    cursor: svg.querySelector(".cursor"),
  }));
  const here = document.querySelector(".here"), clock = document.getElementById("clock");
  const track = data.track && { x: floats(data.track.x), y: floats(data.track.y), turn: floats(data.track.turn) };

  function nearest(t) {
    let low = 0, high = time.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] < t) low = middle; else high = middle;
    }
    return t - time[low] < time[high] - t ? low : high;
  }
  function show(i) {
    const t0 = time[0], span = time[time.length - 1] - t0 || 1;
    for (const p of panels) {
      const x = p.x0 + (time[i] - t0) / span * (p.x1 - p.x0);
      p.cursor.setAttribute("x1", x); p.cursor.setAttribute("x2", x);
      p.cursor.classList.add("on");
    }
    for (const o of outputs) {
      const s = series[+o.dataset.s], v = s.values[i];
      o.textContent = isNaN(v) ? "–" : v.toFixed(s.digits).replace("-", "−");
    }
    if (track && here) {
      here.setAttribute("transform", `translate(${track.x[i]} ${track.y[i]}) rotate(${track.turn[i]}) scale(1.5)`);
      here.classList.add("on");
    }
    if (window.uuvsimScene) window.uuvsimScene.at(time[i]);
    clock.textContent = "t = " + time[i].toFixed(1) + " s"; clock.classList.add("on");
  }
  function hide() {
    document.querySelectorAll(".cursor,.here,#clock").forEach(e => e.classList.remove("on"));
    for (const o of outputs) o.textContent = "";
  }
  for (const p of panels) {
    p.svg.addEventListener("pointermove", e => {
      const box = p.svg.getBoundingClientRect();
      const x = (e.clientX - box.left) / box.width * p.width;
      const part = Math.min(1, Math.max(0, (x - p.x0) / (p.x1 - p.x0)));
      show(nearest(time[0] + part * (time[time.length - 1] - time[0])));
    });
    p.svg.addEventListener("pointerleave", hide);
  }
  const plan = document.getElementById("track");
  if (plan && track) {
    plan.addEventListener("pointermove", e => {
      const box = plan.getBoundingClientRect(), zoom = plan.viewBox.baseVal.width / box.width;
      const x = (e.clientX - box.left) * zoom, y = (e.clientY - box.top) * zoom;
      let best = -1, least = 900;
      for (let i = 0; i < time.length; i++) {
        const d = (track.x[i] - x) ** 2 + (track.y[i] - y) ** 2;
        if (d < least) { least = d; best = i; }
      }
      if (best < 0) hide(); else show(best);
    });
    plan.addEventListener("pointerleave", hide);
  }
  document.getElementById("theme").addEventListener("click", () => {
    const root = document.documentElement;
    const dark = root.dataset.theme ? root.dataset.theme === "dark"
      : matchMedia("(prefers-color-scheme: dark)").matches;
    root.dataset.theme = dark ? "light" : "dark";
  });
  const asked = /[#&]t=([\d.]+)/.exec(location.hash);
  if (asked) show(nearest(+asked[1]));
})();
