// Lodestream for pages: the custom element `<lodestream-viewer>`, and scenes as events.

export { connect, Connection } from './connect.js';
export { LodestreamViewer } from './element.js';
