// Two programs: triangles with the normals of their faces, and lines of a width in pixels.
// Normals are attributes: derivatives of a position lose their digits far from the origin.
const SURFACE = [`#version 300 es
uniform mat4 view, model; in vec3 at, normal; out vec3 place, facing; out float away;
void main() {
  vec4 p = model * vec4(at, 1.0); place = p.xyz; facing = mat3(model) * normal;
  gl_Position = view * p; away = gl_Position.w;
}`,
`#version 300 es
precision highp float;
uniform vec3 colour, water, eye; uniform vec2 depths; uniform float fade, alpha, wet, net, time; in vec3 place, facing; in float away; out vec4 seen;
vec3 tint(float s) {
  vec3 c[6] = vec3[6](vec3(.89,.83,.64), vec3(.72,.81,.61), vec3(.44,.71,.64), vec3(.25,.56,.69), vec3(.16,.39,.6), vec3(.11,.25,.45));
  float f = clamp(s, 0.0, 1.0) * 4.999; int i = int(f);
  return mix(c[i], c[i + 1], f - float(i));
}
// Light that waves focus on the ground: an invented pattern.
float bright(vec2 p) {
  float a = sin(2.1 * p.x + 1.3 * sin(1.7 * p.y + time) + 0.7 * time), b = sin(2.3 * p.y + 1.2 * sin(1.9 * p.x - 1.1 * time) - 0.6 * time);
  return pow(1.0 - 0.5 * abs(a + b), 6.0);
}
void main() {
  vec3 n = normalize(facing);
  if (dot(n, eye - place) < 0.0) n = -n;
  float light = 0.5 + 0.38 * max(dot(n, normalize(vec3(-0.35, -0.5, -0.8))), 0.0) + 0.14 * abs(n.x);
  vec3 c = depths.y > depths.x ? tint((place.z - depths.x) / (depths.y - depths.x)) : colour;
  if (net > 0.0 && n.z < -0.2) light += 0.7 * bright(place.xy / 0.9) * exp(-max(place.z, 0.0) / 12.0);
  if (wet > 0.0) c *= exp(-vec3(0.12, 0.01, 0.0) * clamp(place.z, 0.0, 12.0));  // red goes first
  seen = vec4(mix(c * light, water, 1.0 - exp(-away / fade)), alpha);
}`];
const LINE = [`#version 300 es
uniform mat4 view, model; uniform vec2 screen; uniform float width; in vec2 corner; in vec3 from, to; out float away;
void main() {
  vec4 a = view * model * vec4(from, 1.0), b = view * model * vec4(to, 1.0), p = corner.x < 0.5 ? a : b;
  float w = 0.001;
  if (a.w < w && b.w < w) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  if (a.w < w) a = mix(a, b, (w - a.w) / (b.w - a.w));
  if (b.w < w) b = mix(b, a, (w - b.w) / (a.w - b.w));
  p = corner.x < 0.5 ? a : b;
  vec2 d = (b.xy / b.w - a.xy / a.w) * screen;
  d = dot(d, d) < 1e-12 ? vec2(1.0, 0.0) : normalize(d);
  p.xy += corner.y * vec2(-d.y, d.x) * width / screen * p.w;
  p.z -= 0.0004 * p.w; gl_Position = p; away = p.w;
}`,
`#version 300 es
precision highp float;
uniform vec3 colour, water; uniform float fade, alpha; in float away; out vec4 seen;
void main() { seen = vec4(mix(colour, water, 1.0 - exp(-away / fade)), alpha); }`];

function program(gl, [vertex, fragment]) {
  const p = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const s = gl.createShader(kind);
    gl.shaderSource(s, text); gl.compileShader(s);
    if (!gl.getShaderParameter(s, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(s));
    gl.attachShader(p, s);
  }
  gl.linkProgram(p);
  if (!gl.getProgramParameter(p, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(p));
  const names = {};
  for (let i = 0; i < gl.getProgramParameter(p, gl.ACTIVE_UNIFORMS); i++) {
    const name = gl.getActiveUniform(p, i).name;
    names[name] = gl.getUniformLocation(p, name);
  }
  return { p, u: names, at: name => gl.getAttribLocation(p, name) };
}
// Triangles are flat; with `crease`, a corner's normal is the mean of its triangles whose normals differ by an angle of
// a cosine of at least that: round parts look round, and edges stay sharp.
function surface(gl, prog, vertices, faces, crease) {
  const data = new Float32Array(6 * faces.length), at = k => vertices.subarray(3 * k, 3 * k + 3), around = [], flat = [];
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [at(faces[i]), at(faces[i + 1]), at(faces[i + 2])], whole = cross(sub(b, a), sub(c, a)), normal = unit(whole);
    flat.push({ whole, normal });
    for (let k = i; crease && k < i + 3; k++) (around[faces[k]] ||= []).push(i / 3);
  }
  for (let k = 0; k < faces.length; k++) {
    const own = flat[Math.floor(k / 3)].normal;
    let normal = own;
    if (crease) {
      const near = around[faces[k]].map(f => flat[f]).filter(f => dot(f.normal, own) >= crease);
      normal = unit([0, 1, 2].map(i => near.reduce((s, f) => s + f.whole[i], 1e-12 * own[i])));
    }
    data.set(at(faces[k]), 6 * k); data.set(normal, 6 * k + 3);
  }
  const vao = gl.createVertexArray();
  gl.bindVertexArray(vao);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
  for (const [name, offset] of [["at", 0], ["normal", 12]]) {
    gl.enableVertexAttribArray(prog.at(name));
    gl.vertexAttribPointer(prog.at(name), 3, gl.FLOAT, false, 24, offset);
  }
  gl.bindVertexArray(null);
  return { vao, count: faces.length };
}
// `joined`: each point goes on to the next; else points come in pairs.
function line(gl, prog, corners, points, joined) {
  const vao = gl.createVertexArray(), buffer = gl.createBuffer(), stride = joined ? 12 : 24;
  gl.bindVertexArray(vao);
  gl.bindBuffer(gl.ARRAY_BUFFER, corners);
  gl.enableVertexAttribArray(prog.at("corner"));
  gl.vertexAttribPointer(prog.at("corner"), 2, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, points, gl.DYNAMIC_DRAW);
  for (const [name, offset] of [["from", 0], ["to", 12]]) {
    gl.enableVertexAttribArray(prog.at(name));
    gl.vertexAttribPointer(prog.at(name), 3, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(prog.at(name), 1);
  }
  gl.bindVertexArray(null);
  return { vao, buffer, count: joined ? points.length / 3 - 1 : points.length / 6 };
}
