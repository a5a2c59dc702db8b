// Parts of a scene: which are hidden, tinted, moved or isolated, and what lies under a place of the picture.

import { now } from './clock.js';

/** Share of a tint's colour in the mixture, unless stated. */
const STRENGTH = 0.7;

const pairsOf = (parts) => Uint32Array.from(parts.flatMap(({ instance, part }) => [instance, part]));

/** Time between two questions about a part that a proxy hides, and how many there are. */
const PICK_AGAIN_MS = 50;
const PICKS = 400;

/** Relative difference of axes that a matrix may have from rounding. */
const SIMILARITY = 5e-5;

/**
 * A matrix that moves a part, as 16 numbers in columns. Throws unless it is a similarity: it moves, turns and scales
 * evenly by 1e-6 to 1e6.
 */
function similarity(matrix) {
  const numbers = Float64Array.from(matrix);
  const refuse = (why) => {
    throw new TypeError(`the part's matrix ${why}`);
  };
  if (numbers.length !== 16 || !numbers.every(Number.isFinite)) refuse('must have 16 finite numbers, in columns');
  if (numbers[3] || numbers[7] || numbers[11] || numbers[15] !== 1) refuse('must have the last row 0, 0, 0, 1');
  if (numbers.subarray(12, 15).some((x) => Math.abs(x) > 1e12)) refuse('moves by more than 1e12');
  const axes = [0, 4, 8].map((at) => numbers.subarray(at, at + 3));
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const [[ax, ay, az], b, c] = axes;
  const determinant =
    ax * (b[1] * c[2] - b[2] * c[1]) + ay * (b[2] * c[0] - b[0] * c[2]) + az * (b[0] * c[1] - b[1] * c[0]);
  if (!(determinant > 0 && Number.isFinite(determinant))) refuse('is singular or mirrors');
  const scale = Math.cbrt(determinant);
  if (scale < 1.001e-6 || scale > 0.999e6) refuse('scales beyond 1e-6 to 1e6');
  const uneven = axes.some((axis) => Math.abs(Math.hypot(...axis) - scale) > SIMILARITY * scale);
  const sheared = [[0, 1], [1, 2], [2, 0]].some(
    ([i, j]) => Math.abs(dot(axes[i], axes[j])) > SIMILARITY * scale * scale,
  );
  if (uneven || sheared) refuse('scales unevenly or shears');
  return numbers;
}

/**
 * The parts of a `View`. `viewer` gives its viewer, once there is one, `post` sends to its worker, `redraw` asks for a
 * frame. States are kept for the next viewer, if the device is lost.
 */
export class Parts {
  #viewer;
  #post;
  #redraw;
  /** By `instance:part`: `{ instance, part, hidden, color, strength, matrix }`. */
  #states = new Map();
  #isolated = null;
  #questions = new Map();
  #asked = 0;
  /** Instances of which a part is wanted while a proxy stands for them. */
  #behindProxies = new Set();
  #picks = 0;

  constructor({ viewer, post, redraw }) {
    this.#viewer = viewer;
    this.#post = post;
    this.#redraw = redraw;
  }

  /** Applies all states to a new viewer. */
  restore(viewer) {
    for (const { instance, part, hidden, color, strength, matrix } of this.#states.values()) {
      viewer.set_part(instance, part, hidden, color, strength, matrix);
    }
    if (this.#isolated) viewer.isolate_parts(this.#isolated);
  }

  /** Tells the worker for which instances no proxy may stand, since proxies do not show states of parts, and what moves. */
  #pin() {
    const isolated = [...(this.#isolated ?? [])].filter((_, at) => at % 2 === 0);
    const states = [...this.#states.values()];
    const stated = states.map(({ instance }) => instance);
    const moved = states.filter(({ matrix }) => matrix);
    this.#post({
      kind: 'pin',
      instances: Uint32Array.from([...stated, ...isolated, ...this.#behindProxies]),
      moved: pairsOf(moved),
      matrices: Float64Array.from(moved.flatMap(({ matrix }) => [...matrix])),
    });
  }

  #set(instance, part, change) {
    const key = `${instance}:${part}`;
    const before = this.#states.get(key) ?? { instance, part, hidden: false, color: undefined, strength: STRENGTH };
    const state = { ...before, ...change };
    this.#viewer()?.set_part(instance, part, state.hidden, state.color, state.strength, state.matrix);
    if (state.hidden || state.color !== undefined || state.matrix) this.#states.set(key, state);
    else this.#states.delete(key);
    this.#pin();
    this.#redraw();
  }

  hide(instance, part, hidden = true) {
    this.#set(instance, part, { hidden });
  }

  /** Tints with `#rrggbb`; null ends it. */
  tint(instance, part, color, strength = STRENGTH) {
    if (color !== null && !/^#[0-9a-f]{6}$/i.test(color)) throw new TypeError(`${color} is no colour: write #rrggbb`);
    this.#set(instance, part, { color: color === null ? undefined : parseInt(color.slice(1), 16), strength });
  }

  /** Moves within the instance, in its own units and axes; null moves back. */
  move(instance, part, matrix) {
    this.#set(instance, part, { matrix: matrix === null ? undefined : similarity(matrix) });
  }

  isolate(parts) {
    this.#isolated = parts && pairsOf(parts);
    this.#viewer()?.isolate_parts(this.#isolated ?? undefined);
    this.#pin();
    this.#redraw();
  }

  showAll() {
    this.#states.clear();
    this.#isolated = null;
    this.#viewer()?.clear_parts();
    this.#pin();
    this.#redraw();
  }

  #ask(message) {
    this.#asked += 1;
    const question = this.#asked;
    return new Promise((resolve) => {
      this.#questions.set(question, resolve);
      this.#post({ ...message, question });
    });
  }

  /** Takes an answer of the worker. */
  answer({ question, numbers }) {
    this.#questions.get(question)?.(numbers);
    this.#questions.delete(question);
  }

  /** Answers all questions with nothing: the worker ends. */
  close() {
    for (const resolve of this.#questions.values()) resolve(null);
    this.#questions.clear();
  }

  /**
   * The part at a place, in pixels of the device; null where there is none. A proxy does not know the parts of an instance:
   * then the answer comes once that one is drawn itself, or is null if that takes 20 s or another part is asked for.
   */
  async pick(x, y) {
    const ray = this.#viewer()?.ray(x, y);
    if (!ray) return null;
    this.#picks += 1;
    const own = this.#picks;
    const behind = new Set();
    const setBehind = () => {
      if (behind.size === 0 && this.#behindProxies.size === 0) return;
      this.#behindProxies = new Set(behind);
      this.#pin();
    };
    for (let i = 0; i < PICKS && own === this.#picks; i += 1) {
      const hidden = pairsOf([...this.#states.values()].filter((state) => state.hidden));
      const found = await this.#ask({ kind: 'pick', ray, hidden, isolated: this.#isolated ?? undefined });
      const [instance, part, px, py, pz, distance] = found ?? [];
      if (own !== this.#picks) return null;
      if (!found || part >= 0) {
        behind.clear();
        setBehind();
        return found && { instance, part, place: [px, py, pz], distance };
      }
      if (!behind.has(instance)) {
        behind.add(instance);
        setBehind();
      }
      await new Promise((resolve) => setTimeout(resolve, PICK_AGAIN_MS));
    }
    if (own === this.#picks) {
      behind.clear();
      setBehind();
    }
    return null;
  }

  /** Moves the camera to a part; whether it has faces yet. */
  async fit(instance, part) {
    const bounds = await this.#ask({ kind: 'bounds', instance, part });
    const viewer = this.#viewer();
    if (!bounds || !viewer) return false;
    viewer.fit(now(), ...bounds.slice(0, 4));
    this.#redraw();
    return true;
  }
}
