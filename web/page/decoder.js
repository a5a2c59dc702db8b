// A worker that decodes for the streaming one, whose memory it shares.

import init, { decode_on_this_worker } from './lodestream.js';

onmessage = async ({ data: { module, memory } }) => {
  await init({ module_or_path: module, memory });
  postMessage(null);
  // Waits for work until the worker is terminated.
  decode_on_this_worker();
};
