// The page: a view of the scene that the server offers, with input and overlay.

import { cameraOf } from './camera.js';
import { now } from './clock.js';
import { listen } from './input.js';
import { show } from './overlay.js';
import { files, fragment, preview, stage } from './preview.js';
import { Selection } from './selection.js';
import { View } from './view.js';

const element = (id) => document.getElementById(id);
const server = JSON.parse(element('lodestream-server').textContent);
const canvas = element('view');

const number = (value) => Number(value.toPrecision(9)).toString();

/** Writes the camera into the fragment, without an entry in the history. */
function keepCamera() {
  const camera = view.viewer?.camera();
  if (!camera) return;
  const point = (from) => Array.from(camera.slice(from, from + 3), number).join(',');
  const fov = number((camera[9] * 180) / Math.PI);
  const parts = [`eye=${point(0)}`, `target=${point(3)}`, `up=${point(6)}`, `fov=${fov}`];
  for (const [key, value] of Object.entries(fragment())) {
    if (['scene', 'token', 'transport', 'memory'].includes(key)) parts.push(`${key}=${encodeURIComponent(value)}`);
  }
  history.replaceState(null, '', `#${parts.join(';')}`);
}

/** Where the published scene is, or else the server, by each transport. */
function address({ published, websocket, webtransport }, { scene, transport: only = null }) {
  const file = scene ?? published;
  if (file) return { published: new URL(file, location.href).href };
  const webSocket = new URL(websocket ?? location.pathname, location.href).href.replace(/^http/, 'ws');
  const webTransport = webtransport && {
    url: `https://${location.hostname}:${webtransport.port}${webtransport.path}`,
    hashes: webtransport.certificate_hashes,
  };
  return { webSocket: webSocket.replace(/#.*/, ''), webTransport: webTransport ?? null, only };
}

// The fragment: `eye=x,y,z;target=x,y,z;up=x,y,z;fov=degrees;scene=…;token=…;transport=…;memory=…`, all optional.
const asked = fragment();
const view = new View({
  canvas,
  address: address(server, asked),
  module: files.module,
  worker: files.worker,
  decoder: files.decoder,
  scene: server.scene ?? '',
  token: asked.token ?? '',
  memory: Math.max(Number(asked.memory) || 0, 0),
  camera: cameraOf(asked),
});

const selection = new Selection(view, canvas);
const animate = (act) => () => {
  if (view.viewer) act(view.viewer);
  view.redraw();
};
const actions = {
  KeyF: () => view.viewer?.toggle(),
  KeyR: () => {
    view.viewer?.reset(now());
    view.redraw();
  },
  KeyK: animate((viewer) => viewer.toggle_animation()),
  Comma: animate((viewer) => viewer.step_clip(-1)),
  Period: animate((viewer) => viewer.step_clip(1)),
  KeyH: () => element('overlay').classList.toggle('hidden'),
  KeyP: async () => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(await view.picture());
    link.download = 'lodestream.png';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  },
  KeyX: () => selection.hide(),
  KeyI: () => selection.isolate(),
  KeyU: () => selection.showAll(),
  KeyZ: () => selection.fit(),
  // Phones may lack it, and a browser may refuse it.
  KeyV: () => {
    const root = document.documentElement;
    const change = document.fullscreenElement ? document.exitFullscreen() : root.requestFullscreen?.();
    change?.catch(() => {});
  },
};
listen(view, canvas, actions, now);
show(view, element('overlay'), actions);

let keeping = 0;
view.addEventListener('progress', () => {
  keeping ||= setTimeout(() => {
    keeping = 0;
    keepCamera();
  }, 500);
});
addEventListener('hashchange', () => {
  const camera = cameraOf(fragment());
  if (camera) view.place(camera);
});
view.addEventListener('firstframe', () => {
  element('message')?.remove();
  preview.then((shown) => shown?.close());
});
preview.then((shown) => {
  if (shown) shown.onmove = (camera) => view.place(camera);
});
view.addEventListener('error', ({ detail }) => {
  const message = element('message') ?? document.body.appendChild(document.createElement('p'));
  message.id = 'message';
  message.textContent = detail;
});
addEventListener('pagehide', () => view.close());

/** Figures and control for scripts and tests. */
window.lodestream = { stats: () => ({ ...view.stats(), preview_ms: stage.drawn_ms }), view, preview, selection };
view.start();
