// Workers of the package. Their addresses stand in the calls, where bundlers look for them.

/** Whether the package lies on another origin than the page. Browsers start workers of the page's own origin only. */
const isElsewhere = new URL(import.meta.url).origin !== location.origin;

/** Starts a worker whose script, of the page's origin, imports the package's. */
function startFrom(url) {
  const script = URL.createObjectURL(new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' }));
  const worker = new Worker(script, { type: 'module' });
  // Once it has said something, it has been loaded.
  worker.addEventListener('message', () => URL.revokeObjectURL(script), { once: true });
  return worker;
}

/** Starts the worker of `<lodestream-viewer>`. */
export function startViewerWorker() {
  if (isElsewhere) return startFrom(new URL('./worker.js', import.meta.url));
  return new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
}

/** Starts the worker of `connect`. */
export function startStreamWorker() {
  if (isElsewhere) return startFrom(new URL('./stream-worker.js', import.meta.url));
  return new Worker(new URL('./stream-worker.js', import.meta.url), { type: 'module' });
}
