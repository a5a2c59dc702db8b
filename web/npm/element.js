// The custom element `<lodestream-viewer>`: a streamed scene, drawn by WebGPU.

import { placeOf } from './address.js';
import { cameraOf } from './camera.js';
import { now } from './clock.js';
import { listen } from './input.js';
import { View } from './view.js';
import { startViewerWorker } from './workers.js';

const STYLE = `
  :host { display: block; position: relative; min-width: 1px; min-height: 1px; aspect-ratio: 16 / 9; overflow: hidden; }
  :host([hidden]) { display: none; }
  canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; outline-offset: -2px; }
  slot { display: grid; position: absolute; inset: 0; place-items: center; overflow: auto; pointer-events: none; }
  :host([shown]) slot { display: none; }
`;
/** Attributes that another session is opened for. */
const OF_SESSION = ['src', 'scene', 'token', 'target-px', 'memory'];
/** Attribute that tells styles that there is a picture. */
const SHOWN = 'shown';

/** The ten numbers of an attribute `eye=x,y,z;target=x,y,z;up=x,y,z;fov=degrees`, or null. */
const cameraOfText = (text) => cameraOf(Object.fromEntries((text ?? '').split(';').map((part) => part.split('='))));

const numbersOf = ({ eye, target, up = [0, 1, 0], fov = 50 }) => [...eye, ...target, ...up, (fov * Math.PI) / 180];

/** See `LodestreamViewer` in index.d.ts. */
export class LodestreamViewer extends HTMLElement {
  static observedAttributes = [...OF_SESSION, 'camera'];
  #root = this.attachShadow({ mode: 'open' });
  #view = null;
  /** Options of the view, or of the next one. */
  #options = {};
  #queued = false;

  connectedCallback() {
    this.#openSoon();
  }

  disconnectedCallback() {
    this.#close();
  }

  attributeChangedCallback(name, before, after) {
    if (before === after) return;
    if (name === 'camera') {
      const camera = cameraOfText(after);
      if (camera) this.#setCamera(camera);
    } else {
      this.#openSoon();
    }
  }

  /** Opens a session once all attributes are set. */
  #openSoon() {
    if (this.#queued) return;
    this.#queued = true;
    queueMicrotask(() => {
      this.#queued = false;
      this.#close();
      if (this.isConnected && this.hasAttribute('src')) this.#open();
    });
  }

  #open() {
    const canvas = document.createElement('canvas');
    const style = document.createElement('style');
    style.textContent = STYLE;
    canvas.tabIndex = 0;
    canvas.setAttribute('part', 'canvas');
    canvas.setAttribute('aria-label', this.getAttribute('aria-label') ?? 'A scene; drag to turn, wheel or pinch to come nearer');
    this.#root.replaceChildren(style, canvas, document.createElement('slot'));
    let place;
    try {
      place = placeOf(this.getAttribute('src'), { webTransport: this.webTransport });
    } catch (why) {
      return this.#tell('error', why.message);
    }
    this.#options = {
      canvas,
      address: place.address,
      module: new URL('./lodestream_bg.wasm', import.meta.url).href,
      worker: startViewerWorker,
      scene: this.getAttribute('scene') ?? place.scene,
      token: this.getAttribute('token') ?? '',
      targetPx: Number(this.getAttribute('target-px')) || 1,
      memory: Math.max(Number(this.getAttribute('memory')) || 0, 0),
      camera: this.#options.camera ?? cameraOfText(this.getAttribute('camera')),
    };
    const view = new View(this.#options);
    for (const type of ['firstframe', 'progress', 'settled', 'error']) {
      view.addEventListener(type, ({ detail }) => {
        if (type === 'firstframe') this.setAttribute(SHOWN, '');
        this.#tell(type, detail);
      });
    }
    const reset = () => {
      view.viewer?.reset(now());
      view.redraw();
    };
    listen(view, canvas, { KeyF: () => view.viewer?.toggle(), KeyR: reset }, now, canvas);
    this.#view = view;
    view.start();
  }

  #close() {
    if (this.#view) this.#options = {};
    this.#view?.close();
    this.#view = null;
    this.#root.replaceChildren(document.createElement('slot'));
    this.removeAttribute(SHOWN);
  }

  #tell(type, detail) {
    this.dispatchEvent(new CustomEvent(type, { detail }));
  }

  #setCamera(numbers) {
    const viewer = this.#view?.viewer;
    if (viewer) {
      viewer.set_camera(now(), Float64Array.from(numbers));
      this.#view.redraw();
    } else {
      // The view reads it when its device is open.
      this.#options.camera = numbers;
    }
  }

  /** Addresses of WebTransport, to be set before `src`. */
  webTransport = null;

  get view() {
    const camera = this.#view?.viewer?.camera();
    if (!camera) return null;
    const [eye, target, up] = [0, 3, 6].map((at) => Array.from(camera.slice(at, at + 3)));
    return { eye, target, up, fov: (camera[9] * 180) / Math.PI };
  }

  set view(view) {
    this.setView(view);
  }

  setView(view) {
    this.#setCamera(numbersOf(view));
  }

  switch(technique, on) {
    this.#view?.switch(technique, on);
  }

  part(instance, part = 0) {
    return this.#view ? this.#view.part(instance, part) : Promise.reject(new Error('the element shows no scene'));
  }

  pick(x, y) {
    const ratio = devicePixelRatio;
    return this.#view ? this.#view.parts.pick(x * ratio, y * ratio) : Promise.resolve(null);
  }

  hide(instance, part, hidden = true) {
    this.#view?.parts.hide(instance, part, hidden);
  }

  isolate(parts) {
    this.#view?.parts.isolate(parts);
  }

  tint(instance, part, color, strength) {
    this.#view?.parts.tint(instance, part, color, strength);
  }

  move(instance, part, matrix) {
    this.#view?.parts.move(instance, part, matrix);
  }

  fit(instance, part) {
    return this.#view ? this.#view.parts.fit(instance, part) : Promise.resolve(false);
  }

  showAll() {
    this.#view?.parts.showAll();
  }

  stats() {
    return this.#view?.stats() ?? null;
  }

  picture() {
    return this.#view ? this.#view.picture() : Promise.reject(new Error('the element shows no scene'));
  }
}

if (!customElements.get('lodestream-viewer')) customElements.define('lodestream-viewer', LodestreamViewer);
