// Transports to a server. A link carries frames: one WebSocket message each.

const SUBPROTOCOL = 'lodestream.2';
/** Application close codes of WebSocket begin here (docs/protocol.md). */
const CLOSE_CODE_BASE = 4000;
/** Time after which a transport that is not open has failed. */
const OPEN_TIMEOUT_MS = 10_000;

/**
 * Opens a link and gives it to `events.open`. `events`: `open(link)`, `frame(bytes)`, `lost(reason)`, each called on
 * this thread; `lost` at most once, and nothing after it. Returns a function that abandons the attempt or the link.
 */
export function openLink(url, events) {
  let socket;
  let ended = false;
  const end = (reason) => {
    if (ended) return;
    ended = true;
    clearTimeout(timer);
    socket?.close();
    if (reason !== undefined) events.lost(reason);
  };
  const timer = setTimeout(() => end(`no connection within ${OPEN_TIMEOUT_MS / 1000} s`), OPEN_TIMEOUT_MS);
  try {
    socket = new WebSocket(url, [SUBPROTOCOL]);
  } catch (why) {
    queueMicrotask(() => end(String(why)));
    return () => end();
  }
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    if (ended) return;
    clearTimeout(timer);
    events.open({ name: 'ws', send: (bytes) => socket.send(bytes), close: () => end() });
  };
  socket.onmessage = ({ data }) => {
    if (!ended && data instanceof ArrayBuffer) events.frame(new Uint8Array(data));
  };
  socket.onclose = ({ code, reason }) => {
    const of = code >= CLOSE_CODE_BASE ? 'the server closed the session' : 'the connection was lost';
    end(reason ? `${of}: ${reason}` : of);
  };
  return () => end();
}
