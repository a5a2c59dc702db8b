// A streamed scene in a canvas: the worker that streams, the viewer that draws, and their frames.

import init, { Viewer } from './lodestream.js';
import { now, origin } from './clock.js';
import { PartLookups } from './part-names.js';
import { Parts } from './parts.js';

/** What to tell people whose browser has no WebGPU. */
export const NO_WEBGPU =
  'This page draws with WebGPU, which this browser does not offer here. Current versions of Chrome, Edge, Firefox and ' +
  'Safari have it, on pages from this machine or over https; it may be switched off on this device.';
/** Bytes of steps that one task decodes after the first picture; a larger step is alone. */
const MAX_STEP_BYTES = 1 << 20;
/** Megabytes for the heaps of worker and page, and GPU memory. Less than `least` is not held: heaps and render targets. */
const MEMORY_MB = { desktop: 512, phone: 256, least: 64 };
/** Share of it that the scene may use until the viewer knows what render targets leave: less than that. */
const FIRST_SHARE = 0.2;
/** Adapters that draw on the CPU, by the architecture that the browser tells. */
const SOFTWARE = ['swiftshader', 'llvmpipe'];
/** Interval at which the worker follows an animation, in milliseconds: picking and refinement need no more. */
const FOLLOW_MS = 100;
/** Most devices that are lost one after the other, each within `SOON_MS`, before that is an error. */
const MAX_LOSSES = 5;
const SOON_MS = 60_000;

/** Frees the pictures of a step that is not drawn. */
const release = ({ pictures }) => pictures.forEach(({ bitmap }) => bitmap?.close());

const isPhone = () => matchMedia('(pointer: coarse)').matches && Math.min(screen.width, screen.height) < 900;

/**
 * A view of a scene. Events: `firstframe`, `progress` (detail: the statistics), `settled`, `error` (detail: the message),
 * `clip` (detail: the shown clip and whether it plays, when either changes).
 * Options: `canvas`, `address` (see `openLink`), `module` (its address), `worker` (its address, or a function that starts
 * one), `decoder` (its address, if the module shares memory), `scene`, `token`, `targetPx`, `memory` (most megabytes of
 * heaps and GPU memory), `camera` (ten numbers).
 */
export class View extends EventTarget {
  #options;
  #canvas;
  #viewer = null;
  #worker = null;
  #steps = [];
  #stats = {};
  #message = 'loading';
  #transport = null;
  #decoders = 1;
  #scheduled = false;
  #ended = false;
  #devices = 0;
  #losses = 0;
  /** The longest times of a task's parts since the first picture. */
  #longestMs = {};
  #openedAt = 0;
  /** Number of times that the worker was asked for the whole scene. */
  #generation = 0;
  /** Techniques that were switched. */
  #switched = new Map();
  #shown = false;
  #settled = false;
  #sentView = '';
  #sentBytes = 0;
  #pictures = [];
  #partNames = new PartLookups();
  /** The animation's state that the worker was told last, and when. */
  #told = { clip: undefined, time: undefined, plays: false, at: 0 };
  #observer = new ResizeObserver(() => this.#resize());
  /** Pixels of the device for each of the page, as the canvas has them. */
  #ratio = 0;
  /** Tasks over 50 ms, whatever they do. */
  #longTasks = null;
  #shownAgain = () => this.redraw();
  /** Picking, hiding, tinting, moving, isolating and fitting of parts. */
  parts = new Parts({
    viewer: () => this.#viewer,
    post: (message) => this.#worker?.postMessage(message),
    redraw: () => this.redraw(),
  });
  /** Called before each frame with the time in milliseconds, for input; returns whether it moves the camera. */
  beforeFrame = () => false;
  longestTaskMs = 0;

  constructor(options) {
    super();
    this.#options = options;
    this.#canvas = options.canvas;
    this.#observer.observe(this.#canvas);
    this.#watchTasks();
    document.addEventListener('visibilitychange', this.#shownAgain);
  }

  /** Browsers without this kind of entry count the view's own tasks only. */
  #watchTasks() {
    if (!globalThis.PerformanceObserver?.supportedEntryTypes?.includes('longtask')) return;
    this.#longTasks = new PerformanceObserver((list) => {
      for (const { startTime, duration } of list.getEntries()) {
        // The task that draws the first picture does all that it needs.
        if (this.#shown && startTime > this.#shownMs) this.#noteTask(duration);
      }
    });
    this.#longTasks.observe({ type: 'longtask' });
  }

  #noteTask(ms) {
    this.longestTaskMs = Math.max(this.longestTaskMs, ms);
  }

  /** Starts streaming and drawing. */
  async start() {
    if (!navigator.gpu) return this.#fail(NO_WEBGPU);
    try {
      this.#resize();
      // Connects while the module loads.
      this.#startWorker();
      const [module, adapter] = await Promise.all([
        WebAssembly.compileStreaming(fetch(this.#options.module)),
        navigator.gpu.requestAdapter(),
      ]);
      if (!adapter) {
        this.#worker.terminate();
        return this.#fail(NO_WEBGPU);
      }
      this.#software = adapter.info.isFallbackAdapter || SOFTWARE.includes(adapter.info.architecture);
      this.#module = module;
      if (this.#ended) return;
      this.#worker.postMessage({ kind: 'module', module });
      this.#memory = (await init({ module_or_path: module })).memory;
      await this.#openDevice();
    } catch (why) {
      this.#fail(String(why?.message ?? why));
    }
  }

  #module;
  /** Heap of the page's instance, and bytes of the worker's. */
  #memory;
  #workerHeapBytes = 0;
  #software = false;
  /** Times of the connect call, of the first picture, whichever device drew it, and of the first settled one. */
  #connectedMs = null;
  #shownMs = null;
  #settledMs = null;

  async #openDevice() {
    if (this.#ended) return;
    const viewer = await Viewer.open(this.#canvas, this.#options.targetPx ?? 1, this.#software, this.#memoryCap);
    if (this.#ended) return viewer.close();
    if (this.#options.camera) viewer.set_camera(now(), Float64Array.from(this.#options.camera));
    for (const [technique, on] of this.#switched) viewer.switch(technique, on);
    this.parts.restore(viewer);
    this.#viewer = viewer;
    this.#devices += 1;
    this.#openedAt = now();
    this.redraw();
  }

  /** Most bytes of heaps and GPU memory. */
  get #memoryCap() {
    const megabytes = this.#options.memory || (isPhone() ? MEMORY_MB.phone : MEMORY_MB.desktop);
    return Math.max(megabytes, MEMORY_MB.least) * 2 ** 20;
  }

  #startWorker() {
    const { worker: file } = this.#options;
    const worker = typeof file === 'function' ? file() : new Worker(file, { type: 'module' });
    worker.onmessage = ({ data }) => {
      const [begun, shown] = [now(), this.#shown];
      this.#receive(data);
      if (shown) this.#noteTask(now() - begun);
    };
    worker.onerror = (event) => this.#fail(event.message ?? 'the worker could not be started');
    worker.postMessage({
      kind: 'start',
      module: this.#module,
      epoch: origin(),
      address: this.#options.address,
      scene: this.#options.scene ?? '',
      token: this.#options.token ?? '',
      width: this.#canvas.width,
      height: this.#canvas.height,
      targetPx: this.#options.targetPx ?? 1,
      decoder: this.#options.decoder,
      memoryBytes: this.#memoryCap * FIRST_SHARE,
    });
    this.#worker = worker;
  }

  #receive(data) {
    if (this.#ended) return;
    if (data.failed !== undefined) return this.#fail(data.failed);
    if (data.parts) return this.#partNames.answer(data.parts);
    if (data.question !== undefined) return this.parts.answer(data);
    if (data.step) {
      // Steps from before the last device do not fit it.
      if (data.generation === this.#generation) this.#steps.push(data);
      else release(data);
      return this.redraw();
    }
    this.#stats = data.stats ?? this.#stats;
    this.#message = data.message;
    this.#transport = data.transport;
    this.#decoders = data.decoders;
    this.#workerHeapBytes = data.heapBytes;
    this.#connectedMs = data.begunAt;
    // Zoom, or another screen, may change the ratio alone, of which not all browsers tell.
    if (this.#ratio !== devicePixelRatio) this.#resize();
    const lost = this.#viewer?.failure();
    if (lost === undefined) this.#progress();
    else this.#reopen(lost);
  }

  #progress() {
    if (this.#isSettled()) this.#settledMs ??= now();
    const stats = this.stats();
    this.dispatchEvent(new CustomEvent('progress', { detail: stats }));
    if (stats.settled && !this.#settled) this.dispatchEvent(new CustomEvent('settled', { detail: stats }));
    this.#settled = stats.settled;
  }

  /** Tells an error that ends streaming; what there is can still be looked at. */
  #fail(message) {
    this.#message = message;
    this.#partNames.end(message);
    this.dispatchEvent(new CustomEvent('error', { detail: message }));
  }

  #resize() {
    this.#ratio = devicePixelRatio;
    const [width, height] = [this.#canvas.clientWidth, this.#canvas.clientHeight].map((side) =>
      Math.max(1, Math.round(side * this.#ratio)),
    );
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      this.#canvas.width = width;
      this.#canvas.height = height;
      this.#viewer?.resize(width, height);
    }
    this.redraw();
  }

  /** Asks for another frame. */
  redraw() {
    if (this.#scheduled || this.#ended || !this.#viewer || document.hidden) return;
    this.#scheduled = true;
    requestAnimationFrame(() => this.#frame());
  }

  #frame() {
    this.#scheduled = false;
    const viewer = this.#viewer;
    if (!viewer || this.#ended) return;
    const begun = now();
    // The task that draws the first picture does all that it needs.
    const shown = this.#shown;
    try {
      // A lost device never finishes its frame, so it would seem busy.
      const lost = viewer.failure();
      if (lost !== undefined) return this.#reopen(lost);
      const moving = this.beforeFrame(begun);
      this.#sendView();
      // A device that is busy would only show earlier cameras, one after the other.
      if (viewer.is_busy(begun)) return this.redraw();
      const times = [now()];
      for (const { step, pictures } of this.#steps.splice(0, this.#countNext())) {
        for (const { number, uses, bitmap, texels, bits } of pictures) {
          if (bitmap) viewer.hold_picture(number, uses, bitmap);
          else viewer.hold_texels(number, uses, bits, texels);
        }
        viewer.push(step);
        this.#worker.postMessage({ kind: 'taken' });
      }
      times.push(now());
      viewer.upload(begun);
      times.push(now());
      const again = viewer.frame(begun) || this.#steps.length > 0;
      this.#followAnimation(viewer);
      times.push(now());
      if (shown) this.#note(times);
      for (const take of this.#pictures.splice(0)) this.#canvas.toBlob(take, 'image/png');
      if (!this.#shown && viewer.presented_ms() !== undefined) {
        this.#shown = true;
        this.#shownMs = viewer.presented_ms();
        this.dispatchEvent(new CustomEvent('firstframe', { detail: this.stats() }));
      }
      if (again || moving || viewer.is_busy(now())) this.redraw();
      else this.#progress();
      // An animation goes on when all the rest is final.
      if (again && !this.#settled && this.#isSettled()) this.#progress();
    } catch (why) {
      this.#reopen(String(why?.message ?? why));
    }
    if (shown) this.#noteTask(now() - begun);
  }

  /** Number of waiting steps to take in this task: all that the first picture needs. */
  #countNext() {
    if (!this.#shown) return this.#steps.length;
    let bytes = 0;
    const beyond = this.#steps.findIndex(({ step }) => (bytes += step.length) > MAX_STEP_BYTES);
    return beyond < 0 ? this.#steps.length : Math.max(beyond, 1);
  }

  /** Notes how long the parts of a task took, between these times. */
  #note(times) {
    ['steps', 'upload', 'draw'].forEach((part, at) => {
      this.#longestMs[part] = Math.max(this.#longestMs[part] ?? 0, times[at + 1] - times[at]);
    });
  }

  /** Opens another device after an error of the last one; the worker's session goes on and gives the whole scene again. */
  async #reopen(why) {
    const viewer = this.#viewer;
    this.#viewer = null;
    this.#losses = now() - this.#openedAt < SOON_MS ? this.#losses + 1 : 1;
    try {
      this.#options.camera = viewer.camera() ?? this.#options.camera;
      viewer.close();
      if (this.#losses >= MAX_LOSSES) return this.#fail(why);
      this.#steps.splice(0).forEach(release);
      this.#generation += 1;
      this.#worker.postMessage({ kind: 'restate', generation: this.#generation });
      await this.#openDevice();
    } catch (again) {
      this.#fail(String(again?.message ?? again));
    }
  }

  /** Tells the worker where the scene's clip is. */
  #followAnimation(viewer) {
    const [clip, time, plays, at] = [viewer.clip(), viewer.clip_time(), viewer.plays(), now()];
    const told = this.#told;
    if (clip !== told.clip || plays !== told.plays) {
      this.dispatchEvent(new CustomEvent('clip', { detail: { clip, plays } }));
    } else if (time === told.time || (plays && at < told.at + FOLLOW_MS)) {
      return;
    }
    this.#told = { clip, time, plays, at };
    if (clip !== undefined) this.#worker.postMessage({ kind: 'animate', clip, time });
  }

  #sendView() {
    // The size of the canvas and the scene's terrain change it.
    const bytes = this.#viewer.content_bytes();
    if (bytes !== this.#sentBytes) this.#worker.postMessage({ kind: 'memory', bytes });
    this.#sentBytes = bytes;
    const view = this.#viewer.view(now());
    if (!view) return;
    const key = view.join();
    if (key === this.#sentView) return;
    this.#sentView = key;
    this.#worker.postMessage({ kind: 'view', view });
  }

  /** The viewer, once the device is open: camera and techniques. */
  get viewer() {
    return this.#viewer;
  }

  /** Moves to a camera of ten numbers, or starts from it. */
  place(camera) {
    this.#options.camera = camera;
    this.#viewer?.set_camera(now(), Float64Array.from(camera));
    this.redraw();
  }

  /** Switches a technique, see `Viewer.switch`. */
  switch(technique, on) {
    this.#viewer?.switch(technique, on);
    this.#switched.set(technique, on);
    if (technique === 'shadows') this.#worker?.postMessage({ kind: 'shadows', on });
    this.redraw();
  }

  /** A connection problem and what is done about it, for users. */
  get message() {
    return this.#message;
  }

  #isSettled() {
    return Boolean(this.#stats.settled && !this.#steps.length && this.#viewer?.is_final());
  }

  /** The figures of `lodestream-viewer --stats`, with its names where both have them, and more. */
  stats() {
    const viewer = this.#viewer;
    const settled = this.#isSettled();
    const sinceConnect = (ms) => (ms === null || this.#connectedMs === null ? null : ms - this.#connectedMs);
    return {
      ...this.#stats,
      transport: this.#transport,
      decoders: this.#decoders,
      settled,
      ttff_presented_ms: sinceConnect(this.#shownMs),
      ttff_presented_since_navigation_ms: this.#shownMs,
      settled_presented_ms: sinceConnect(this.#settledMs),
      frame_count: viewer?.frames() ?? 0,
      frame_ms: viewer?.frame_ms() ?? null,
      quality: viewer?.quality() ?? null,
      devices: this.#devices,
      adapter: viewer?.adapter() ?? null,
      heap_bytes: [this.#workerHeapBytes, this.#memory?.buffer.byteLength ?? 0],
      gpu_bytes: viewer?.gpu_bytes() ?? 0,
      target_bytes: viewer?.target_bytes() ?? 0,
      memory_cap_bytes: this.#memoryCap,
      longest_task_ms: this.longestTaskMs,
      longest_part_ms: { ...this.#longestMs },
      most_uploaded_bytes: viewer?.most_uploaded() ?? 0,
      message: this.#message,
    };
  }

  /** The next frame as a PNG. */
  picture() {
    return new Promise((resolve) => {
      this.#pictures.push(resolve);
      this.redraw();
    });
  }

  /** What a part is called, see `LodestreamViewer.part`. */
  part(instance, part = 0) {
    return this.#partNames.ask(this.#ended ? null : this.#worker, instance, part);
  }

  /** Ends the session and frees the device. */
  close() {
    if (this.#ended) return;
    this.#ended = true;
    this.#partNames.end('the session has ended');
    this.#observer.disconnect();
    this.#longTasks?.disconnect();
    document.removeEventListener('visibilitychange', this.#shownAgain);
    this.#worker?.postMessage({ kind: 'leave' });
    this.parts.close();
    this.#viewer?.close();
    this.#viewer = null;
  }
}
