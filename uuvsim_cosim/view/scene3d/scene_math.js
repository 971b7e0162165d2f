// Matrices are 16 numbers, column by column, as WebGL wants them; points are N, E, D [m].
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
function unit(a) {
  const n = Math.hypot(...a) || 1;
  return [a[0] / n, a[1] / n, a[2] / n];
}
function times(a, b) {
  const m = new Float32Array(16);
  for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) {
    let s = 0;
    for (let k = 0; k < 4; k++) s += a[4 * k + r] * b[4 * c + k];
    m[4 * c + r] = s;
  }
  return m;
}
function perspective(fov, aspect, near, far) {
  const f = 1 / Math.tan(fov / 2), d = near - far;
  return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / d, -1, 0, 0, 2 * far * near / d, 0]);
}
function lookAt(eye, at, up) {
  const z = unit(sub(eye, at)), x = unit(cross(up, z)), y = cross(z, x);
  return new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0,
    -dot(x, eye), -dot(y, eye), -dot(z, eye), 1]);
}
// From a body to n: q is scalar first.
function pose(p, q) {
  const [w, x, y, z] = q;
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
    p[0], p[1], p[2], 1]);
}
const still = () => pose([0, 0, 0], [1, 0, 0, 0]);
// Between two attitudes, the shorter way.
function between(q, p, part) {
  const sign = q[0] * p[0] + q[1] * p[1] + q[2] * p[2] + q[3] * p[3] < 0 ? -1 : 1;
  const m = q.map((v, i) => v + part * (sign * p[i] - v)), n = Math.hypot(...m) || 1;
  return m.map(v => v / n);
}
// A round step that cuts a span into about `count` parts.
function nice(span, count) {
  const rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(m => m * power >= rough * 0.999);
}
// Segments at which a triangulated surface has the depths k * step: { level: [n e d n e d ...] }.
function contours(vertices, faces, step) {
  const found = new Map();
  for (let i = 0; i < faces.length; i += 3) {
    const p = [0, 1, 2].map(k => [0, 1, 2].map(c => vertices[3 * faces[i + k] + c]));
    const low = Math.min(p[0][2], p[1][2], p[2][2]), high = Math.max(p[0][2], p[1][2], p[2][2]);
    for (let k = Math.ceil(low / step); k * step < high; k++) {
      const level = k * step, ends = [];
      for (const [a, b] of [[p[0], p[1]], [p[1], p[2]], [p[2], p[0]]]) {
        if ((a[2] <= level) === (b[2] <= level)) continue;
        const part = (level - a[2]) / (b[2] - a[2]);
        ends.push(...a.map((v, c) => v + part * (b[c] - v)));
      }
      if (ends.length === 6) {
        if (!found.has(level)) found.set(level, []);
        found.get(level).push(...ends);
      }
    }
  }
  return found;
}
// Move an eye along a direction until it is outside of all spheres [centre, radius].
function outside(eye, direction, spheres) {
  for (let again = 0; again < 4; again++) for (const [centre, radius] of spheres) {
    const o = sub(eye, centre), c = dot(o, o) - radius * radius;
    if (c >= -1e-9) continue;
    const b = dot(o, direction), s = Math.sqrt(b * b - c) - b;
    eye = eye.map((v, i) => v + s * direction[i]);
  }
  return eye;
}
// Pixels of a point, or null behind the camera.
function project(view, p, width, height) {
  const c = [0, 1, 3].map(r => view[r] * p[0] + view[4 + r] * p[1] + view[8 + r] * p[2] + view[12 + r]);
  return c[2] > 1e-6 ? [(0.5 + 0.5 * c[0] / c[2]) * width, (0.5 - 0.5 * c[1] / c[2]) * height] : null;
}
