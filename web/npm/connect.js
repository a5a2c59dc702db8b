// A scene as events, for pages that draw by other means than WebGPU: `connect`.

import { origin } from './clock.js';
import { placeOf } from './address.js';
import { Model } from './model.js';
import { PartLookups } from './part-names.js';
import { numbersOf } from './views.js';
import { startStreamWorker } from './workers.js';

/** Received blobs that are kept. */
const CACHE_BYTES = 64 << 20;

/** See `Connection` in index.d.ts. */
export class Connection extends EventTarget {
  #worker;
  #model;
  #stats = {};
  #message = 'connecting';
  #transport = null;
  #settled = false;
  #view = null;
  #viewNumber = 0;
  #parts = new PartLookups();

  constructor(src, options) {
    super();
    const { address, scene } = placeOf(src, options);
    this.#model = new Model(options.relativeTo ?? [0, 0, 0]);
    const view = options.view && numbersOf(options.view);
    this.#worker = startStreamWorker();
    this.#worker.onmessage = ({ data }) => this.#receive(data);
    this.#worker.onerror = (event) => this.#fail(event.message ?? 'the worker could not be started');
    this.#worker.postMessage({
      kind: 'start',
      deltas: true,
      module: new URL('./streamer_bg.wasm', import.meta.url).href,
      epoch: origin(),
      address,
      scene,
      token: options.token ?? '',
      // Of the scene's start camera, until a view is set.
      width: options.width ?? 1280,
      height: options.height ?? 720,
      targetPx: options.targetPx ?? 1,
      cacheBytes: options.cacheBytes ?? CACHE_BYTES,
      view,
    });
  }

  /** What has been received. */
  get model() {
    return this.#model;
  }

  setView(view) {
    const numbers = numbersOf(view);
    // A camera that stands still costs nothing.
    if (this.#view && numbers.every((number, at) => number === this.#view[at])) return;
    this.#view = numbers;
    this.#viewNumber += 1;
    this.#settled = false;
    this.#worker?.postMessage({ kind: 'viewNumbers', view: numbers, number: this.#viewNumber });
  }

  part(instance, part = 0) {
    return this.#parts.ask(this.#worker, instance, part);
  }

  setToken(token) {
    this.#worker?.postMessage({ kind: 'token', token });
  }

  stats() {
    return { ...this.#stats, settled: this.#settled, transport: this.#transport, message: this.#message };
  }

  close() {
    this.#worker?.postMessage({ kind: 'leave' });
    this.#worker = null;
    this.#parts.end('the session has ended');
  }

  #receive(data) {
    if (!this.#worker) return;
    if (data.failed !== undefined) return this.#fail(data.failed);
    if (data.parts) return this.#parts.answer(data.parts);
    if (data.deltas) return this.#apply(data.deltas);
    this.#stats = data.stats ?? this.#stats;
    this.#message = data.message;
    this.#transport = data.transport;
    const settles = Boolean(this.#stats.settled && data.view === this.#viewNumber);
    const settled = settles && !this.#settled;
    this.#settled = settles;
    this.#tell('progress', this.stats());
    if (settled) this.#tell('settled', this.stats());
  }

  /** Takes a step at once, so that no frame of the page shows a part of it. */
  #apply(deltas) {
    for (const delta of deltas) {
      for (const [type, detail] of this.#model.apply(delta)) this.#tell(type, detail);
    }
    this.#worker?.postMessage({ kind: 'taken' });
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  #fail(message) {
    this.#message = message;
    this.#parts.end(message);
    this.#tell('error', message);
  }
}

/** Opens a session with a server. */
export const connect = (src, options = {}) => new Connection(src, options);
