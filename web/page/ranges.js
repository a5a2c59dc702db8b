// Range requests for a published scene: the streamer says which, `fetch` makes them.

import { now } from './clock.js';

/** The bytes that the streamer asks for first, whatever the scene. */
const FIRST_BYTES = 65536;

/**
 * The `Content-Range` of a response, or what it must be where another origin does not expose the header: a body that is
 * shorter than asked ends where the file does.
 */
function contentRange(response, start, end) {
  const stated = response.headers.get('Content-Range');
  if (stated || response.type !== 'cors' || response.status !== 206) return stated ?? undefined;
  const length = Number(response.headers.get('Content-Length') ?? end - start);
  const ends = start + length;
  return `bytes ${start}-${ends - 1}/${ends < end ? ends : '*'}`;
}

function ask(url, start, end, options) {
  return fetch(url, { ...options, headers: { Range: `bytes=${start}-${end - 1}` } });
}

export class Ranges {
  #scene;
  #changed;
  #running = new Map();
  #first = null;

  /**
   * `scene`: the address of the published scene. `changed()` is called when the streamer has received something. `early`:
   * the streamer is not there yet, so its first request is made before it asks.
   */
  constructor(scene, changed, early) {
    this.#scene = scene;
    this.#changed = changed;
    if (!early) return;
    this.#first = ask(scene, 0, FIRST_BYTES, {});
    // A failure shows when the response is used.
    this.#first.catch(() => {});
  }

  /** Makes the requests that the streamer wants, and aborts those that it does not want any more. */
  turn(streamer) {
    for (let id; (id = streamer.cancelled()) !== undefined; ) {
      this.#running.get(id)?.abort();
      this.#running.delete(id);
    }
    for (let request; (request = streamer.request(now())); ) this.#make(streamer, request);
  }

  async #make(streamer, { id, name, start, end, reload }) {
    const aborter = new AbortController();
    this.#running.set(id, aborter);
    const here = () => this.#running.get(id) === aborter;
    try {
      const response = await this.#answer(name, start, end, reload, aborter.signal);
      if (!here()) return;
      const encoding = response.headers.get('Content-Encoding');
      const encoded = Boolean(encoding && encoding !== 'identity');
      streamer.response_head(now(), id, response.status, contentRange(response, start, end), encoded);
      this.#changed();
      if (response.status !== 206) return aborter.abort();
      const reader = response.body.getReader();
      for (;;) {
        const { value, done } = await reader.read();
        if (!here()) return;
        if (done) break;
        streamer.response_body(now(), id, value);
        this.#changed();
      }
      streamer.response_end(now(), id);
    } catch (why) {
      if (here()) streamer.request_failed(now(), id, `it cannot be fetched: ${why?.message ?? why}`);
    } finally {
      if (here()) this.#running.delete(id);
      this.#changed();
    }
  }

  #answer(name, start, end, reload, signal) {
    const first = this.#first;
    this.#first = null;
    if (first && !name && !reload && start === 0 && end === FIRST_BYTES) return first;
    const url = new URL(name ?? '', this.#scene);
    url.search = new URL(this.#scene).search;
    return ask(name ? url : this.#scene, start, end, { signal, cache: reload ? 'no-cache' : 'default' });
  }

  /** Aborts everything. */
  close() {
    for (const aborter of this.#running.values()) aborter.abort();
    this.#running.clear();
  }
}
