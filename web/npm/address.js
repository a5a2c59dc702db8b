// Addresses of scenes: `ws://host:port/scene`, as the server prints them, or the same with wss, http or https; and of
// published scenes, `https://host/path/NAME.lss`.

/** Where a scene is: the transports' addresses, see `openLink`, and its name, empty for the server's only scene. */
export function placeOf(src, { transport = null, webTransport = null } = {}) {
  let url;
  try {
    url = new URL(src, document.baseURI);
  } catch {
    throw new TypeError(`"${src}" is not the address of a scene: write ws://HOST:PORT/SCENE or https://HOST/NAME.lss`);
  }
  url.hash = '';
  if (/^https?:$/.test(url.protocol) && url.pathname.endsWith('.lss')) return { address: { published: url.href }, scene: '' };
  url.protocol = url.protocol.replace(/^http/, 'ws');
  if (!/^wss?:$/.test(url.protocol) || url.pathname.lastIndexOf('/') !== 0) {
    throw new TypeError(`"${src}" is not the address of a scene: write ws://HOST:PORT/SCENE or https://HOST/NAME.lss`);
  }
  const only = transport === 'ws' || transport === 'webtransport' ? transport : null;
  return {
    address: { webSocket: url.href, webTransport, only },
    scene: decodeURIComponent(url.pathname.slice(1)),
  };
}
