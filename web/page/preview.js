// The first stage: draws the scene's preview (docs/formats.md) while the client loads, then loads the client. It has no
// WebAssembly and no dependency, so that a slow link shows a picture early.

import { cameraOf } from './camera.js';
import { now } from './clock.js';

const json = (id) => JSON.parse(document.getElementById(id).textContent);

const VERTEX = `#version 300 es
in vec3 position;
in vec2 octahedral;
in vec3 tint;
uniform mat4 clip;
uniform vec3 offset;
uniform vec4 rotation;
uniform float scale;
out vec3 normal;
out vec3 color;
out vec3 from_eye;
vec3 turned(vec3 v) {
  return v + 2.0 * cross(rotation.xyz, cross(rotation.xyz, v) + rotation.w * v);
}
void main() {
  vec2 o = octahedral / 127.5 - 1.0;
  vec3 n = vec3(o, 1.0 - abs(o.x) - abs(o.y));
  n.xy -= mix(vec2(-1), vec2(1), greaterThanEqual(n.xy, vec2(0))) * max(-n.z, 0.0);
  normal = turned(normalize(n));
  color = tint;
  from_eye = turned(position * scale) + offset;
  gl_Position = clip * vec4(from_eye, 1);
}`;

// Sunlight and a sky brighter from above; haze; the client's tone mapping (Narkowicz 2016) and the sRGB curve.
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 normal;
in vec3 color;
in vec3 from_eye;
uniform vec3 albedo, emission, sun, to_sun, up, above, below, haze;
uniform float unlit, flat_faces, visibility;
out vec4 shown;
void main() {
  vec3 n = flat_faces > 0.0 ? normalize(cross(dFdx(from_eye), dFdy(from_eye))) : normalize(normal);
  vec3 light = sun * max(dot(n, to_sun), 0.0) + mix(below, above, 0.5 + 0.5 * dot(n, up));
  vec3 x = color * albedo * mix(light, vec3(1.6), unlit) + emission;
  x = mix(haze, x, exp(-length(from_eye) / visibility));
  x = clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
  shown = vec4(mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThan(x, vec3(0.0031308))), 1);
}`;

const SKY = `#version 300 es
precision highp float;
uniform vec3 high, low, ground;
uniform vec4 line;
uniform vec2 size;
out vec4 shown;
void main() {
  float up = dot(line.xyz, vec3(gl_FragCoord.xy / size * 2.0 - 1.0, 1));
  vec3 x = mix(low, high, sqrt(clamp(up * line.w, 0.0, 1.0)));
  x = mix(x, ground, smoothstep(0.0, 0.1, -up));
  x = clamp((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0);
  shown = vec4(mix(1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, 12.92 * x, lessThan(x, vec3(0.0031308))), 1);
}`;

/** Time after which the client loads without a preview. */
const TIMEOUT_MS = 4000;
/** Rate of the link above which the client is loaded beside the preview, in kbit/s. */
const FAST_KBIT_S = 8000;
/** Longest wait for the preview's picture, before the client is compiled. */
const PAINT_MS = 300;
/** Radiance of a white surface in the sun, as the client exposes it. */
const WHITE = 1.6;
/** The client's atmosphere at noon: zenith, horizon and what lies below it. */
const AIR = { high: [0.045, 0.11, 0.28], low: [0.24, 0.33, 0.44], below: [0.16, 0.15, 0.13] };
/** Mean colours of sand, grass, rock, snow and water. */
const GROUND = [
  [0.54, 0.45, 0.3],
  [0.08, 0.11, 0.03],
  [0.2, 0.18, 0.15],
  [0.75, 0.78, 0.82],
  [0.03, 0.06, 0.07],
];

const add = (a, b, scale = 1) => a.map((part, axis) => part + scale * b[axis]);
const subtract = (a, b) => add(a, b, -1);
const times = (a, scale) => a.map((part) => part * scale);
const dot = (a, b) => a.reduce((sum, part, axis) => sum + part * b[axis], 0);
const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
const unit = (a) => times(a, 1 / (Math.hypot(...a) || 1));
const linear = (byte) => (byte <= 10 ? byte / 3294.6 : ((byte / 255 + 0.055) / 1.055) ** 2.4);
const turned = ([x, y, z, w], v) => {
  const q = [x, y, z];
  return add(v, cross(q, add(cross(q, v), v, w)), 2);
};
const smoothstep = (low, high, x) => {
  const t = Math.min(Math.max((x - low) / (high - low), 0), 1);
  return t * t * (3 - 2 * t);
};

/** Inflates a preview; returns its head, and functions that give the next array of `count` numbers or corners. */
async function read(response) {
  const inflated = response.body.pipeThrough(new DecompressionStream('deflate-raw'));
  const bytes = new Uint8Array(await new Response(inflated).arrayBuffer());
  const length = new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + length)));
  if (head.version !== 1) throw new Error(`preview of version ${head.version}`);
  let at = 4 + length;
  const coded = (count, decode) => {
    const array = Uint16Array.from({ length: count }, (_, i) => decode(bytes[at + i] | (bytes[at + count + i] << 8)));
    at += 2 * count;
    return array;
  };
  const numbers = (count) => {
    let before = 0;
    return coded(count, (number) => (before += (number >>> 1) ^ -(number & 1)));
  };
  // Distances below the next vertex that no corner has named.
  const corners = (count, state) => coded(count, (distance) => (distance ? state.next - distance : state.next++));
  return { head, numbers, corners };
}

/** A preview in a canvas. `camera`: ten numbers, which a drag or the wheel changes. */
export class Preview {
  #gl;
  #canvas;
  #head;
  #meshes = [];
  #programs;
  #observer;
  camera;
  /** Called when a person has moved the camera. */
  onmove = () => {};

  constructor(canvas, { head, numbers, corners }, camera) {
    const gl = canvas.getContext('webgl2', { antialias: true, alpha: false });
    if (!gl) throw new Error('no WebGL 2');
    this.#gl = gl;
    this.#canvas = canvas;
    this.#head = head;
    this.camera = camera ?? head.camera;
    this.#programs = { surface: this.#program(VERTEX, FRAGMENT), sky: this.#program(FULL, SKY) };
    for (const mesh of head.meshes) this.#meshes.push(this.#mesh(mesh, numbers, corners));
    if (head.ground) this.ground = this.#ground(head.ground, numbers);
    this.#listen();
    this.#observer = new ResizeObserver(() => this.draw());
    this.#observer.observe(canvas);
    this.draw();
  }

  #program(...sources) {
    const gl = this.#gl;
    const program = gl.createProgram();
    [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, index) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, sources[index]);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    ['position', 'octahedral', 'tint'].forEach((name, place) => gl.bindAttribLocation(program, place, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? '');
    const places = {};
    for (let i = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i -= 1) {
      const { name } = gl.getActiveUniform(program, i);
      places[name] = gl.getUniformLocation(program, name);
    }
    return { program, places };
  }

  /** Vertex arrays of coordinates, normals and colours (each with its number of parts), and faces. */
  #buffers(attributes, indices) {
    const gl = this.#gl;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    attributes.forEach(([data, parts, kind, normalised], place) => {
      if (!data) return gl.vertexAttrib3f(place, 1, 1, 1);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, parts, kind, normalised, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    return array;
  }

  #mesh({ vertices, start, step, flat, colored, groups }, numbers, corners) {
    const gl = this.#gl;
    const together = (Kind, parts) => {
      const all = new Kind(parts * vertices);
      for (let part = 0; part < parts; part += 1) {
        numbers(vertices).forEach((number, i) => {
          all[parts * i + part] = number;
        });
      }
      return all;
    };
    const positions = together(Float32Array, 3);
    const normals = flat ? null : together(Uint8Array, 2);
    const colors = colored ? together(Uint8Array, 3) : null;
    const state = { next: 0 };
    const indices = groups.map(({ faces }) => corners(3 * faces, state));
    const whole = new Uint16Array(indices.reduce((sum, part) => sum + part.length, 0));
    let first = 0;
    const looks = groups.map(({ look }, group) => {
      whole.set(indices[group], first);
      const of = (color, mean) => (color ? color.map((c, i) => c * (mean ? linear(mean[i]) : 1)) : [0, 0, 0]);
      const albedo = of(look.color, look.texture);
      const emission = of(look.emission, look.emission_texture);
      const drawn = { first: 2 * first, count: indices[group].length, albedo, emission, unlit: look.unlit, flat: look.flat };
      first += drawn.count;
      return drawn;
    });
    const attributes = [
      [positions, 3, gl.FLOAT, false],
      [normals, 2, gl.UNSIGNED_BYTE, false],
      [colors, 3, gl.UNSIGNED_BYTE, true],
    ];
    return { array: this.#buffers(attributes, whole), start, step, flat, looks };
  }

  /** The ground's rings as a mesh around the point at height 0 below the first eye. */
  #ground({ center, inner, ratio, rings, side, low, step, zones, water }, numbers) {
    const gl = this.#gl;
    const around = 4 * side;
    const heights = Float64Array.from(numbers(rings * around), (number) => low + step * number);
    const level = water ?? -Infinity;
    const positions = new Float32Array(3 * heights.length);
    heights.forEach((height, i) => {
      const [along, edge] = [(2 * (i % side)) / side - 1, Math.floor((i % around) / side)];
      const half = inner * ratio ** Math.floor(i / around);
      const [x, z] = [[1, along], [-along, 1], [-1, -along], [along, -1]][edge];
      positions.set([x * half, Math.max(height, level), z * half], 3 * i);
    });
    const point = (i) => positions.subarray(3 * i, 3 * i + 3);
    const normals = new Uint8Array(2 * heights.length);
    const colors = new Uint8Array(3 * heights.length);
    const indices = [];
    const [sand, grass, hill] = zones;
    const width = 0.08 * Math.min(grass - sand, hill - grass);
    heights.forEach((height, i) => {
      const [ring, spoke] = [Math.floor(i / around), i % around];
      const [left, right] = [-1, 1].map((turn) => ring * around + ((spoke + turn + around) % around));
      const [inward, outward] = [Math.max(ring - 1, 0), Math.min(ring + 1, rings - 1)].map((at) => at * around + spoke);
      const along = Array.from(subtract(Array.from(point(right)), point(left)));
      const n = unit(cross(along, subtract(Array.from(point(outward)), point(inward))));
      const sum = Math.abs(n[0]) + Math.abs(n[1]) + Math.abs(n[2]);
      // Only hemispheres of positive z need no folding; the vertex shader unfolds the others.
      let [x, y] = [n[0] / sum, n[1] / sum];
      if (n[2] < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
      normals.set([127.5 * (x + 1), 127.5 * (y + 1)], 2 * i);
      const [green, bare, white] = [[sand, 1], [grass, 2.5], [hill, 2.5]].map(([zone, wide]) =>
        smoothstep(zone - wide * width, zone + wide * width, height),
      );
      const flat = smoothstep(0.72, 0.86, n[1]);
      const weights = [1 - green, green * (1 - bare), green * bare * (1 - white), green * bare * white];
      let color = [0, 0, 0];
      weights.forEach((weight, zone) => {
        color = add(color, GROUND[zone], weight * flat);
      });
      color = height < level ? GROUND[4] : add(color, GROUND[2], 1 - flat);
      colors.set(times(color, 255), 3 * i);
      if (ring + 1 < rings) indices.push(i, i + around, right, right, i + around, right + around);
    });
    // Ground between the first ring's points.
    for (let spoke = 1; spoke + 1 < around; spoke += 1) indices.push(0, spoke, spoke + 1);
    const attributes = [
      [positions, 3, gl.FLOAT, false],
      [normals, 2, gl.UNSIGNED_BYTE, false],
      [colors, 3, gl.UNSIGNED_BYTE, true],
    ];
    const count = indices.length;
    return { array: this.#buffers(attributes, Uint16Array.from(indices)), count, center, outer: inner * ratio ** rings };
  }

  /** Draws a picture. */
  draw() {
    const gl = this.#gl;
    const size = ['clientWidth', 'clientHeight'].map((side) =>
      Math.max(1, Math.round(this.#canvas[side] * Math.min(devicePixelRatio, 2))),
    );
    if (this.#canvas.width !== size[0] || this.#canvas.height !== size[1]) {
      [this.#canvas.width, this.#canvas.height] = size;
    }
    gl.viewport(0, 0, ...size);
    const { sun, sky } = this.#head;
    const camera = this.camera;
    const [eye, target, upward] = [0, 3, 6].map((from) => camera.slice(from, from + 3));
    const reach = Math.hypot(...subtract(target, eye));
    const forward = unit(subtract(target, eye));
    const right = unit(cross(forward, upward));
    const up = cross(right, forward);
    const zoom = 1 / Math.tan(camera[9] / 2);
    const [near, far] = [0.005 * reach, 2000 * reach];
    const aspect = size[0] / size[1];
    const depth = [(far + near) / (near - far), (2 * far * near) / (near - far)];
    const column = (axis) => [(right[axis] * zoom) / aspect, up[axis] * zoom, -forward[axis] * depth[0], forward[axis]];
    const clip = [...column(0), ...column(1), ...column(2), 0, 0, depth[1], 0];

    // The client's exposure: a white surface in the sun is just below white.
    const luminance = (c) => dot(c, [0.2126, 0.7152, 0.0722]);
    const expose = sky ? WHITE / Math.max(luminance(add(sun.color, sky.background)), 1e-6) : 1;
    const high = sky ? times(sky.background, 0.7 * expose) : AIR.high;
    const low = sky ? times(sky.background, 1.3 * expose) : AIR.low;
    const below = sky ? times(sky.ambient, expose) : AIR.below;

    gl.disable(gl.DEPTH_TEST);
    gl.useProgram(this.#programs.sky.program);
    const { places: skyPlaces } = this.#programs.sky;
    const world = unit(upward);
    gl.uniform3fv(skyPlaces.high, high);
    gl.uniform3fv(skyPlaces.low, low);
    gl.uniform3fv(skyPlaces.ground, below);
    gl.uniform2fv(skyPlaces.size, size);
    gl.uniform4f(skyPlaces.line, (dot(right, world) * aspect) / zoom, dot(up, world) / zoom, dot(forward, world), 1.2);
    gl.bindVertexArray(null);
    gl.drawArrays(gl.TRIANGLES, 0, 3);

    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const { program, places } = this.#programs.surface;
    gl.useProgram(program);
    gl.uniformMatrix4fv(places.clip, false, clip);
    gl.uniform3fv(places.to_sun, sun.direction);
    gl.uniform3fv(places.up, world);
    gl.uniform3fv(places.sun, sky ? times(sun.color, expose) : times(unit(sun.color), 1.25 * Math.sqrt(3)));
    gl.uniform3fv(places.above, sky ? low : [0.3, 0.36, 0.45]);
    gl.uniform3fv(places.below, below);
    gl.uniform3fv(places.haze, low);
    gl.uniform1f(places.visibility, this.ground ? this.ground.outer : 1e30);
    for (const [number, ...placed] of this.#head.instances) {
      const mesh = this.#meshes[number];
      const [rotation, scale] = [placed.slice(3, 7), placed[7]];
      const start = add(turned(rotation, times(mesh.start, scale)), placed.slice(0, 3));
      gl.uniform3fv(places.offset, subtract(start, eye));
      gl.uniform4fv(places.rotation, rotation);
      gl.uniform1f(places.scale, mesh.step * scale);
      gl.bindVertexArray(mesh.array);
      for (const { first, count, albedo, emission, unlit, flat } of mesh.looks) {
        gl.uniform3fv(places.albedo, albedo);
        gl.uniform3fv(places.emission, emission);
        gl.uniform1f(places.unlit, unlit ? 1 : 0);
        gl.uniform1f(places.flat_faces, flat || mesh.flat ? 1 : 0);
        gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_SHORT, first);
      }
    }
    if (!this.ground) return;
    const { array, count, center } = this.ground;
    gl.uniform3fv(places.offset, subtract([center[0], 0, center[1]], eye));
    gl.uniform4f(places.rotation, 0, 0, 0, 1);
    gl.uniform1f(places.scale, 1);
    gl.uniform3f(places.albedo, 1, 1, 1);
    gl.uniform3f(places.emission, 0, 0, 0);
    gl.uniform1f(places.unlit, 0);
    gl.uniform1f(places.flat_faces, 0);
    gl.bindVertexArray(array);
    // The cells' straight edges must not cover what stands on the ground.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(2, 64);
    gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_SHORT, 0);
    gl.disable(gl.POLYGON_OFFSET_FILL);
  }

  /** A drag turns about the target, the wheel comes nearer. */
  #listen() {
    const moved = (change) => {
      const eye = subtract(this.camera.slice(0, 3), this.camera.slice(3, 6));
      const place = change(eye);
      this.camera = [...add(this.camera.slice(3, 6), place), ...this.camera.slice(3)];
      this.onmove(this.camera);
      requestAnimationFrame(() => this.#gl && this.draw());
    };
    this.#canvas.addEventListener('pointermove', ({ buttons, movementX, movementY }) => {
      if (!(buttons & 1)) return;
      moved((eye) => {
        const world = unit(this.camera.slice(6, 9));
        const reach = Math.hypot(...eye);
        const spin = (-movementX * Math.PI) / this.#canvas.clientHeight;
        const flat = add(times(eye, Math.cos(spin)), cross(world, eye), Math.sin(spin));
        const about = add(flat, world, dot(world, eye) * (1 - Math.cos(spin)));
        const raised = add(about, world, (movementY * Math.PI * reach) / this.#canvas.clientHeight);
        const risen = times(unit(raised), reach);
        return Math.abs(dot(unit(risen), world)) < 0.99 ? risen : about;
      });
    });
    const wheel = ({ deltaY }) => moved((eye) => times(eye, 0.88 ** (-deltaY / 100)));
    this.#canvas.addEventListener('wheel', wheel, { passive: true });
  }

  /** Frees the graphics memory and removes the canvas. */
  close() {
    this.#observer.disconnect();
    this.#gl?.getExtension('WEBGL_lose_context')?.loseContext();
    this.#gl = null;
    this.#canvas.remove();
  }
}

/** Covers the picture, for the sky. */
const FULL = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1);
}`;

/** Parts of the address' fragment. */
export function fragment() {
  const entries = location.hash.slice(1).split(';').map((part) => part.split('='));
  return Object.fromEntries(entries.filter(([key, value]) => key && value).map(([k, v]) => [k, decodeURIComponent(v)]));
}

/** When the preview was drawn, in milliseconds since the navigation; or why it was not. */
export const stage = { drawn_ms: null, why: null };

/** Whether workers may share memory: the module's tasks wait by `Atomics.waitAsync` then, and it reserves 1 GiB. */
function sharesMemory() {
  if (!globalThis.crossOriginIsolated || !('waitAsync' in Atomics)) return false;
  try {
    return Boolean(new WebAssembly.Memory({ initial: 1, maximum: 16384, shared: true }));
  } catch {
    return false;
  }
}

/** The client's files: where workers share memory, with several that decode. */
export const files = json('lodestream-files')[sharesMemory() ? 'shared' : 'plain'];

/** The preview's contents, or null if the page has none. */
async function contents() {
  const { preview: file } = json('lodestream-server');
  if (!file || fragment().scene) return null;
  const response = await fetch(file, { signal: AbortSignal.timeout(TIMEOUT_MS) });
  return response.ok ? read(response) : null;
}

/** Whether the link brought the preview so fast that the client comes soon, too. */
function isFast() {
  const timings = performance.getEntriesByType('resource').filter(({ name }) => name.endsWith('.bin'));
  return timings.some(
    ({ transferSize, responseStart, responseEnd }) => 8 * transferSize > FAST_KBIT_S * (responseEnd - responseStart),
  );
}

/** Requests the client's files. */
function request() {
  const hint = (attributes) => document.head.append(Object.assign(document.createElement('link'), attributes));
  hint({ rel: 'preload', href: files.module, as: 'fetch', type: 'application/wasm', crossOrigin: 'anonymous' });
  for (const href of files.scripts) hint({ rel: 'modulepreload', href });
}

/** Draws the preview, and resolves once it is on the screen. */
async function show(contents) {
  const canvas = document.createElement('canvas');
  canvas.id = 'preview';
  document.body.prepend(canvas);
  try {
    const preview = new Preview(canvas, contents, cameraOf(fragment()));
    document.getElementById('message')?.classList.add('corner');
    const painted = new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
    painted.then(() => {
      stage.drawn_ms = now();
    });
    // A hidden page has no frames.
    await Promise.race([painted, new Promise((done) => setTimeout(done, PAINT_MS))]);
    return preview;
  } catch (why) {
    canvas.remove();
    throw why;
  }
}

/** Shows the preview and loads the client; returns the preview, or null if there is none or it cannot be drawn. */
async function start() {
  const failed = (why) => {
    stage.why = String(why?.message ?? why);
    return null;
  };
  const read = await contents().catch(failed);
  // Only now, since more connections would take their shares of the link from the preview.
  request();
  // Compiling would delay the preview's picture, which matters where the client comes late.
  const fast = !read || isFast();
  if (fast) import(files.main);
  const preview = read ? await show(read).catch(failed) : null;
  if (!fast) import(files.main);
  return preview;
}

export const preview = start();
