// Parts of a scene: which are hidden, tinted or isolated, and what lies under a place of the picture.

import { now } from './clock.js';

/** Share of a tint's colour in the mixture, unless stated. */
const STRENGTH = 0.7;

const pairsOf = (parts) => Uint32Array.from(parts.flatMap(({ instance, part }) => [instance, part]));

/**
 * The parts of a `View`. `viewer` gives its viewer, once there is one, `post` sends to its worker, `redraw` asks for a
 * frame. States are kept for the next viewer, if the device is lost.
 */
export class Parts {
  #viewer;
  #post;
  #redraw;
  /** By `instance:part`: `{ instance, part, hidden, color, strength }`. */
  #states = new Map();
  #isolated = null;
  #questions = new Map();
  #asked = 0;

  constructor({ viewer, post, redraw }) {
    this.#viewer = viewer;
    this.#post = post;
    this.#redraw = redraw;
  }

  /** Applies all states to a new viewer. */
  restore(viewer) {
    for (const { instance, part, hidden, color, strength } of this.#states.values()) {
      viewer.set_part(instance, part, hidden, color, strength);
    }
    if (this.#isolated) viewer.isolate_parts(this.#isolated);
  }

  /** Tells the worker for which instances no proxy may stand: proxies do not show states of parts. */
  #pin() {
    const isolated = [...(this.#isolated ?? [])].filter((_, at) => at % 2 === 0);
    const stated = [...this.#states.values()].map(({ instance }) => instance);
    this.#post({ kind: 'pin', instances: Uint32Array.from([...stated, ...isolated]) });
  }

  #set(instance, part, change) {
    const key = `${instance}:${part}`;
    const before = this.#states.get(key) ?? { instance, part, hidden: false, color: undefined, strength: STRENGTH };
    const state = { ...before, ...change };
    this.#viewer()?.set_part(instance, part, state.hidden, state.color, state.strength);
    if (state.hidden || state.color !== undefined) this.#states.set(key, state);
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

  /** The part at a place, in pixels of the device; null where there is none. */
  async pick(x, y) {
    const ray = this.#viewer()?.ray(x, y);
    if (!ray) return null;
    const hidden = pairsOf([...this.#states.values()].filter((state) => state.hidden));
    const found = await this.#ask({ kind: 'pick', ray, hidden, isolated: this.#isolated ?? undefined });
    if (!found) return null;
    const [instance, part, px, py, pz, distance] = found;
    return { instance, part, place: [px, py, pz], distance };
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
