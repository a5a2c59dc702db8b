// Transports to a server: WebTransport where both sides have it, and WebSocket, which works where UDP is blocked.

const SUBPROTOCOL = 'lodestream.2';
/** Application close codes of WebSocket begin here (docs/protocol.md). */
const CLOSE_CODE_BASE = 4000;
/** Kind of the stream that carries the client's frames. */
const CONTROL_STREAM = 0;
/** Time after which a transport that is not open has failed. */
const OPEN_TIMEOUT_MS = 10_000;
/** Time for WebTransport to open before WebSocket is tried too: it opens in one round trip more than TCP. */
const HEAD_START_MS = 200;

/**
 * Opens a link by whichever transport opens first. `events`: `open(link)`; `data(take)`, where `take(streamer, now)` hands
 * what has arrived to a streamer; `lost(reason)`, at most once and last. `address`: `webSocket`, an URL; `webTransport`,
 * an URL and hashes, or null; `only`, the name of the one transport to use, or null; `resumes`, whether the streamer has
 * something of the scene. Returns a function that abandons the attempt or the link.
 */
export function openLink(address, events) {
  let winner = null;
  let ended = false;
  const attempts = new Set();
  const end = (reason) => {
    if (ended) return;
    ended = true;
    clearTimeout(timer);
    clearTimeout(second);
    for (const attempt of attempts) attempt.close();
    if (reason !== undefined) events.lost(reason);
  };
  const start = (open, target) => {
    if (ended || winner) return;
    const attempt = open(target, {
      open(link) {
        if (ended || winner) return attempt.close();
        winner = attempt;
        clearTimeout(timer);
        clearTimeout(second);
        for (const other of attempts) if (other !== attempt) other.close();
        events.open({ ...link, close: () => end() });
      },
      data: (take) => winner === attempt && !ended && events.data(take),
      lost(reason) {
        attempts.delete(attempt);
        if (winner === attempt) end(reason);
        else if (!winner && !begun && address.only !== 'webtransport') startWebSocket();
        else if (!winner && !attempts.size) end(reason);
      },
    });
    attempts.add(attempt);
  };
  // What the streamer has is not pushed again (docs/protocol.md).
  const query = address.resumes ? '?resume' : '';
  let begun = false;
  const startWebSocket = () => {
    if (begun) return;
    begun = true;
    start(openWebSocket, address.webSocket + query);
  };
  const timer = setTimeout(() => end(`no connection within ${OPEN_TIMEOUT_MS / 1000} s`), OPEN_TIMEOUT_MS);
  let second = 0;
  const wantsFirst = address.webTransport && address.only !== 'ws' && typeof WebTransport === 'function';
  if (wantsFirst) {
    if (address.only !== 'webtransport') second = setTimeout(startWebSocket, HEAD_START_MS);
    start(openWebTransport, { ...address.webTransport, url: address.webTransport.url + query });
  } else if (address.only === 'webtransport') {
    queueMicrotask(() => end('the server or this browser has no WebTransport'));
  } else {
    startWebSocket();
  }
  return () => end();
}

function openWebSocket(url, events) {
  const socket = new WebSocket(url, [SUBPROTOCOL]);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => events.open({ name: 'ws', send: (bytes) => socket.send(bytes) });
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer) events.data((streamer, now) => streamer.receive(now, new Uint8Array(data)));
  };
  socket.onclose = ({ code, reason }) => {
    const of = code >= CLOSE_CODE_BASE ? 'the server closed the session' : 'the connection was lost';
    events.lost(reason ? `${of}: ${reason}` : of);
  };
  return { close: () => socket.close() };
}

const bytesOfHex = (hex) => Uint8Array.from(hex.match(/../g) ?? [], (byte) => parseInt(byte, 16));

function openWebTransport({ url, hashes }, events) {
  const options = { congestionControl: 'low-latency' };
  if (hashes.length) {
    options.serverCertificateHashes = hashes.map((hex) => ({ algorithm: 'sha-256', value: bytesOfHex(hex) }));
  }
  const transport = new WebTransport(url, options);
  const lost = (why) => events.lost(`the connection was lost: ${why?.message ?? why?.reason ?? why}`);
  transport.closed.then(lost, lost);
  serve(transport, events).catch(() => {});
  return {
    close() {
      transport.ready.then(() => transport.close()).catch(() => {});
    },
  };
}

/** Opens the client's stream, and reads the server's until the session ends, which `closed` tells. */
async function serve(transport, events) {
  await transport.ready;
  const writer = (await transport.createUnidirectionalStream()).getWriter();
  const send = (bytes) => writer.write(bytes).catch(() => {});
  send(Uint8Array.of(CONTROL_STREAM));
  events.open({ name: 'webtransport', send });
  const streams = transport.incomingUnidirectionalStreams.getReader();
  for (let number = 0; ; number += 1) {
    const { value, done } = await streams.read();
    if (done) return;
    read(value.getReader(), number, events);
  }
}

async function read(reader, number, events) {
  try {
    for (;;) {
      const { value, done } = await reader.read();
      if (done) break;
      events.data((streamer, now) => streamer.receive_stream(now, number, value));
    }
    events.data((streamer, now) => streamer.end_stream(now, number));
  } catch {
    events.data((streamer, now) => streamer.reset_stream(now, number));
  }
}
