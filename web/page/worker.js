// The worker: transport, session, selection and refinement, apart from the thread that draws.

import init, { Streamer } from './lodestream.js';
import { follow, now } from './clock.js';
import { openLink } from './link.js';
import { decode } from './pictures.js';
import { Ranges } from './ranges.js';

/** Most steps that the page has not taken yet. */
const MAX_STEPS = 8;
/** Most workers that decode besides this one. */
const MAX_DECODERS = 4;
/** Interval of reports to the page. */
const REPORT_MS = 100;
/** Pauses between attempts to connect: from the first, doubled, to the last. */
const RETRY_MS = [250, 8000];

let streamer;
/** The module's heap. */
let memory;
let options;
let link = null;
/** Range requests, if the scene is published. */
let ranges = null;
let abandon = () => {};
/** What arrived before the module was ready. */
let early = [];
/** Instances for which no proxy may stand, and moved parts, from before the module was ready. */
let pinned = null;
/** Lookups of parts from before the module was ready. */
const earlyParts = [];
let opened = false;
let untaken = 0;
/** Number of times that the page has asked for the whole scene: it drops the steps from before. */
let generation = 0;
let failures = 0;
/** Whether to connect again once the module is there: without it, attempts would follow one another on slow links. */
let waitsForModule = false;
let message = 'connecting';
/** Time of the connect call. */
let begunAt = null;
let reportedAt = -Infinity;
let settled = false;
let timer = 0;
let left = false;
/** Workers that decode, this one included. */
let decoders = 1;
/** Number of the last view that was set, of those that the page numbers. */
let viewNumber = 0;

let giveModule;
const laterModule = new Promise((resolve) => {
  giveModule = resolve;
});

// A task without the 4 ms that nested timers wait.
const soon = new MessageChannel();
let queued = false;
soon.port1.onmessage = () => {
  queued = false;
  turn();
};
function turnSoon() {
  if (queued) return;
  queued = true;
  soon.port2.postMessage(0);
}

function connect() {
  if (options.address.published) return read();
  abandon = openLink({ ...options.address, resumes: streamer?.has_scene() ?? false }, {
    open(newLink) {
      link = newLink;
      opened = true;
      begin();
    },
    data(take) {
      if (streamer && !opened) {
        take(streamer, now());
        turnSoon();
      } else {
        early.push(take);
      }
    },
    lost(reason) {
      link = null;
      opened = false;
      early = [];
      if (streamer) streamer.lost(now(), reason);
      message = reason;
      retry();
    },
  });
}

/** Reads a published scene: there is nothing to open. */
function read() {
  ranges = new Ranges(options.address.published, turnSoon, !streamer);
  abandon = () => ranges.close();
  link = { name: 'http', send() {} };
  opened = true;
  begin();
}

/** Begins the session once both the link and the module are there. */
function begin() {
  if (!opened || !streamer) return;
  opened = false;
  message = null;
  if (ranges) streamer.connect_ranges(now());
  else streamer.connect(now());
  for (const take of early.splice(0)) take(streamer, now());
  turnSoon();
}

function retry() {
  report();
  if (left) return;
  if (!streamer) {
    waitsForModule = true;
    return;
  }
  const wait = Math.min(RETRY_MS[0] * 2 ** failures, RETRY_MS[1]);
  failures += 1;
  // Spread, so that the clients of a server that restarts do not come at once.
  setTimeout(connect, wait * (0.75 + 0.5 * Math.random()));
}

function turn() {
  if (!streamer) return;
  clearTimeout(timer);
  const again = streamer.turn(now());
  for (let frame; link && (frame = streamer.transmit(now())); ) link.send(frame);
  ranges?.turn(streamer);
  while (untaken < MAX_STEPS) {
    // As objects for pages that draw by other means, as bytes for the viewer.
    const step = options.deltas ? streamer.deltas(now()) : streamer.step(now());
    if (!step) break;
    untaken += 1;
    if (options.deltas) postMessage({ deltas: step.deltas }, step.transfer);
    else post(step, streamer.pictures());
  }
  const parts = streamer.parts();
  if (parts.length) postMessage({ parts });
  const closed = streamer.closed();
  if (closed !== undefined && link) {
    const mayRetry = streamer.may_retry();
    message = closed;
    abandon();
    link = null;
    if (mayRetry) retry();
    else postMessage({ failed: closed });
  }
  if (now() - reportedAt >= REPORT_MS || streamer.is_settled() !== settled) report();
  if (again && untaken < MAX_STEPS) {
    turnSoon();
  } else {
    const due = streamer.timeout_ms();
    const wait = due === undefined ? REPORT_MS : Math.min(due - now(), REPORT_MS);
    timer = setTimeout(turn, Math.max(wait, 0));
  }
}

/** Steps are posted in their order, each after its pictures. */
let posted = Promise.resolve();

function post(step, pictures) {
  const decoded = pictures.map((picture) => decodeOne(picture));
  const of = generation;
  posted = posted.then(async () => {
    const held = (await Promise.all(decoded)).filter(Boolean);
    const moved = held.map(({ bitmap, texels }) => bitmap ?? texels.buffer);
    postMessage({ step, pictures: held, generation: of }, [step.buffer, ...moved]);
    for (const { number } of held) streamer.decoded(now(), number, undefined);
    if (pictures.length) turnSoon();
  });
}

/** The decoded picture; none, told to the streamer, if the browser cannot decode it. */
async function decodeOne(picture) {
  const { number, uses } = picture;
  try {
    const decoded = await decode(picture);
    if (picture.planes) decoded.texels = streamer.texels(number, decoded.texels);
    return { number, uses, ...decoded };
  } catch (why) {
    streamer.decoded(now(), number, String(why?.message ?? why));
    turnSoon();
    return null;
  }
}

function report() {
  reportedAt = now();
  const stats = streamer?.stats();
  if (stats) {
    settled = stats.settled;
    if (stats.connection === 'open') failures = 0;
  }
  const why = message ?? streamer?.trouble() ?? null;
  const heapBytes = memory?.buffer.byteLength ?? 0;
  postMessage({ stats, message: why, transport: link?.name ?? null, view: viewNumber, heapBytes, decoders, begunAt });
}

/** Lets other workers decode too, of which each has a core besides the page's and this one's. */
async function startDecoders(module) {
  const count = Math.max(1, Math.min(navigator.hardwareConcurrency - 2, MAX_DECODERS));
  streamer.prepare_decoders(count);
  const start = () =>
    new Promise((ready) => {
      const worker = new Worker(options.decoder, { type: 'module' });
      worker.onmessage = ready;
      worker.postMessage({ module, memory });
    });
  await Promise.all(Array.from({ length: count }, start));
  streamer.use_decoders(count);
  decoders += count;
}

const answer = (question, numbers) => postMessage({ question, numbers: numbers ?? null });

const handlers = {
  async start(start) {
    options = start;
    follow(start.epoch);
    begunAt = now();
    connect();
    const module = start.module ?? (await laterModule);
    ({ memory } = await init({ module_or_path: module }));
    const { width, height, targetPx, scene, token, memoryBytes, cacheBytes } = start;
    streamer = new Streamer(width, height, targetPx, scene, token, memoryBytes, cacheBytes);
    streamer.begin(begunAt);
    if (pinned) handlers.pin(pinned);
    for (const { instance, part } of earlyParts.splice(0)) streamer.look_up_part(now(), instance, part);
    if (start.view) streamer.set_view_numbers(now(), start.view);
    // Without other workers this one decodes.
    if (start.decoder) startDecoders(module).catch(() => {});
    if (waitsForModule) connect();
    else begin();
  },
  /** The module, where it was not there at the start: the connection opens while it loads. */
  module({ module }) {
    giveModule(module);
  },
  view({ view }) {
    streamer?.set_view(now(), view);
    turnSoon();
  },
  // As numbers, from pages that draw by other means; one that comes early is the first.
  viewNumbers({ view, number }) {
    viewNumber = number;
    if (streamer) streamer.set_view_numbers(now(), view);
    else options.view = view;
    turnSoon();
  },
  // What render targets leave; it may come before the module is ready.
  memory({ bytes }) {
    options.memoryBytes = bytes;
    streamer?.bound_memory(bytes);
    turnSoon();
  },
  animate({ clip, time }) {
    streamer?.animate(clip, time);
    turnSoon();
  },
  shadows({ on }) {
    streamer?.set_shadows(on);
    turnSoon();
  },
  part({ instance, part }) {
    if (streamer) streamer.look_up_part(now(), instance, part);
    else earlyParts.push({ instance, part });
    turnSoon();
  },
  token({ token }) {
    streamer?.set_token(token);
    turnSoon();
  },
  taken() {
    untaken -= 1;
    turnSoon();
  },
  restate({ generation: next }) {
    generation = next;
    untaken = 0;
    streamer?.restate(now());
    turnSoon();
  },
  pin({ instances, moved, matrices }) {
    pinned = { instances, moved, matrices };
    streamer?.pin(instances);
    streamer?.move_parts(moved, matrices);
    turnSoon();
  },
  pick({ question, ray, hidden, isolated }) {
    answer(question, streamer?.pick(ray, hidden, isolated));
  },
  bounds({ question, instance, part }) {
    answer(question, streamer?.part_bounds(instance, part));
  },
  leave() {
    left = true;
    streamer?.leave(now());
    turn();
    abandon();
    close();
  },
};

onmessage = async ({ data }) => {
  try {
    await handlers[data.kind](data);
  } catch (why) {
    postMessage({ failed: String(why?.message ?? why) });
  }
};
