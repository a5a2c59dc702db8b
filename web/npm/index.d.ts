// Types of the package. Axes are right-handed. World coordinates are f64 and may be large; what is drawn in f32 is relative
// to a point that is stated.

export type Vector = [x: number, y: number, z: number];

/** A camera. */
export interface Camera {
  /** Position, in world units. */
  eye: Vector;
  /** Point in the middle of the picture, in world units. */
  target: Vector;
  /** Roughly up; by default [0, 1, 0]. */
  up?: Vector;
  /** Vertical field of view in degrees, in (0, 180); by default 50. */
  fov?: number;
}

/** What a picture shows, for `Connection.setView`. */
export interface View {
  /** Position of the camera, in world units. */
  eye: Vector;
  /** Unit quaternion x, y, z, w from view space (x right, y up, the view along −z) to the world, as three.js has it. */
  rotation?: [x: number, y: number, z: number, w: number];
  /** In place of `rotation`: the point to look at. */
  target?: Vector;
  /** With `target`: roughly up; by default [0, 1, 0]. */
  up?: Vector;
  /** Vertical field of view in degrees; by default 50. */
  fov?: number;
  /** Size of the picture, in pixels of the device, 1 to 65,535. */
  width: number;
  height: number;
  /** Error on the screen to refine to, in pixels; by default 1. Half of it costs about four times the faces. */
  targetPx?: number;
}

/** Address for WebTransport, as the daemon's page has it. It is raced against WebSocket. */
export interface WebTransportAddress {
  url: string;
  /** SHA-256 of accepted certificates as hexadecimal digits; empty for certificates that browsers trust. */
  hashes: string[];
}

/** Figures of a session, with the names of `lodestream-viewer --stats`; some of them: */
export interface Stats {
  /** Whether all is there that the view needs. */
  settled: boolean;
  /** Bytes received, over all connections of the session together. */
  bytes?: number;
  /** Bytes of what the view needs, and of what of it has not arrived. */
  needed_bytes?: number;
  missing_bytes?: number;
  /** Time from connect to what the first frame needs, in milliseconds. */
  ttff_ms?: number | null;
  /** Faces of all assets. */
  faces?: number;
  /** Largest error on the screen, in pixels. */
  max_screen_error_px?: number | null;
  /** `http` for published scenes. */
  transport: 'ws' | 'webtransport' | 'http' | null;
  /** A problem of the connection, for people; attempts go on. */
  message: string | null;
  [name: string]: unknown;
}

export interface ConnectOptions {
  /** Token, for servers that require one. */
  token?: string;
  /** The view to start from; else the scene's start camera with a picture of `width` × `height` (1280 × 720) pixels. */
  view?: View;
  width?: number;
  height?: number;
  targetPx?: number;
  /** World point that instances' matrices are relative to; by default [0, 0, 0]. For scenes far from there, a point in them. */
  relativeTo?: Vector;
  /** Most bytes of received blobs that are kept; by default 64 MiB. */
  cacheBytes?: number;
  /** The only transport to use. */
  transport?: 'ws' | 'webtransport';
  webTransport?: WebTransportAddress;
}

/** The scene, known first. */
export interface Scene {
  name: string;
  /** Linear RGB; `direction` is a unit vector towards the directional light. */
  light: { direction: Vector; color: Vector; ambient: Vector };
  /** Linear RGB. */
  background: Vector;
  camera: Required<Camera>;
  assetCount: number;
  instanceCount: number;
  /** Whether there is terrain, which `connect` does not give. */
  hasTerrain: boolean;
}

/** A metallic–roughness material as in glTF 2.0. Textures are indices into `Asset.textures`, or null. */
export interface Material {
  name: string;
  /** Linear RGB and opacity, 0 to 1; multiplies colours of vertices and texture. */
  baseColor: [r: number, g: number, b: number, a: number];
  roughness: number;
  metallic: number;
  /** Linear RGB. */
  emission: Vector;
  alphaMode: 'opaque' | 'mask' | 'blend';
  alphaCutoff: number;
  unlit: boolean;
  /** Along u and v. */
  wrap: ['repeat' | 'clamp' | 'mirror', 'repeat' | 'clamp' | 'mirror'];
  baseColorTexture: number | null;
  /** Red: occlusion, green: roughness, blue: metal. */
  surfaceTexture: number | null;
  /** Red: occlusion, of the other set of texture coordinates than `surfaceTexture`. */
  occlusionTexture: number | null;
  /** x along u, y along v (up), z outwards; a component c is stored as (c + 1) / 2. */
  normalTexture: number | null;
  normalScale: number;
  emissionTexture: number | null;
  /** White is the surface; black lies `reliefDepth` below it, in units of texture coordinates. */
  heightTexture: number | null;
  reliefDepth: number;
  /** Textures that use `Mesh.secondUvs`. */
  secondUv: ('baseColorTexture' | 'surfaceTexture' | 'occlusionTexture' | 'normalTexture' | 'emissionTexture')[];
}

export interface TextureInfo {
  /** `color` is sRGB, the others are linear. */
  kind: 'color' | 'height' | 'normal' | 'surface';
  /** Size of the finest level, in texels. */
  width: number;
  height: number;
  /** Mean colour, 0 to 255, to draw until a level arrives. */
  mean: [r: number, g: number, b: number] | null;
  /** Coarsest first. */
  levels: { width: number; height: number }[];
}

/** A mesh as it is now. The arrays are the package's: read them, or hand them to a renderer, but do not change them. */
export interface Mesh {
  /** Three for each vertex, in the asset's units, relative to `Asset.origin`. Arrays may be longer than `vertexCount` says. */
  positions: Float32Array;
  /** Three for each vertex: a unit vector, or zero where there is none. */
  normals: Float32Array;
  /** Two for each vertex: u, and v up from the bottom of the texture. */
  uvs: Float32Array;
  /** The same of a second set, which few materials use; null before a vertex has one. */
  secondUvs: Float32Array | null;
  /** Four for each vertex: linear RGB and opacity, of which 65,535 is 1. */
  colors: Uint16Array;
  /** One for each vertex: its part, 0 in assets that are not divided. All corners of a face have the same. */
  parts: Uint32Array;
  vertexCount: number;
  /** By material: three vertices for each face, counter-clockwise from outside. Unused faces are 0, 0, 0 and cover nothing. */
  indices: Uint32Array[];
  /** By material: numbers in use of `indices`. */
  indexCounts: number[];
}

export interface Asset {
  asset: number;
  /** Origin of positions and of the sphere, in the asset's units (f64). */
  origin: Vector;
  /** Bounds at every level, relative to `origin`. */
  center: Vector;
  radius: number;
  materials: Material[];
  textures: TextureInfo[];
  /** Textures that equal one of another asset: `of` is its asset and index. Each still gets its own events. */
  shared: { texture: number; of: [asset: number, texture: number] }[];
  mesh: Mesh;
}

/** A placed asset. */
export interface Instance {
  /** Number within the scene; null for a proxy, a mesh that stands for many instances. */
  index: number | null;
  /** Number of the proxy; null for an instance. */
  proxy: number | null;
  asset: number;
  /** Whether it is drawn: an instance is not while a proxy stands for it. */
  drawn: boolean;
  /** 16 numbers by columns, from an asset's positions to the world, less `relativeTo`; computed in f64. */
  matrix: Float64Array;
}

/** New contents of some vertices and faces. All of a step's events come in one task: draw after it, not between. */
export interface MeshChange {
  asset: number;
  /** The mesh with this change. */
  mesh: Mesh;
  /** Runs of vertices from vertex `first` on, with the shapes of `Mesh`. */
  vertices: {
    first: number;
    positions: Float32Array;
    normals: Float32Array;
    uvs: Float32Array;
    secondUvs: Float32Array | null;
    colors: Uint16Array;
    parts: Uint32Array;
  }[];
  /** Runs of faces from face `first` on of a material's list. */
  faces: { material: number; first: number; indices: Uint32Array }[];
  /** Whether the mesh's arrays of vertices are new ones, because others were too short, or far too long. */
  verticesReplaced: boolean;
  /** Materials whose arrays of indices are new ones. */
  indicesReplaced: number[];
}

/** A decoded level of a texture, or a tile of one: levels with a side of over 256 texels have tiles, except heights. */
export interface TextureChange {
  asset: number;
  texture: number;
  /** 0 is the coarsest. Its size is in `TextureInfo.levels`. */
  level: number;
  /** Number of the tile, row by row; null for a whole level. Tiles have 256² texels, at the right and lower edge fewer. */
  tile: number | null;
  /** First texel within the level, from the left and the top, and size. */
  x: number;
  y: number;
  width: number;
  height: number;
  /** Rows from the top. Height maps are `r8` or `r16`. */
  format: 'rgba8' | 'r8' | 'r16';
  texels: Uint8Array | Uint16Array;
}

/** A tile that is no longer needed and may be dropped. It comes again if it is needed again. */
export interface TileRemoved {
  asset: number;
  texture: number;
  level: number;
  tile: number;
}

/** A part of an instance: 0 for assets that are not divided. */
export interface ScenePart {
  /** Number of the instance within the scene. */
  instance: number;
  part: number;
}

/** The nearest part on a ray from the eye. */
export interface PickedPart extends ScenePart {
  /** Where, in world units. */
  place: Vector;
  /** From the eye, in world units. */
  distance: number;
}

/** Punctual lights: positions and ranges in world units, intensities in candela (linear RGB), angles in radians. */
export interface LightPage {
  /** Pages come in any order. */
  page: number;
  lights: {
    position: Vector;
    intensity: Vector;
    range: number;
    spot: { direction: Vector; inner: number; outer: number } | null;
  }[];
}

/** What a part is called: a mesh that a node of a model file places. */
export interface PartInfo {
  /** Name of the node, else of its mesh. */
  name: string;
  /** Names of the nodes above it, from the root, with `/` between them; of several models, the model's name first. */
  path: string;
  /** The `extras` of the node, else of its mesh; null without. */
  extras: unknown;
}

/** What has been received. */
export interface Model {
  scene: Scene | null;
  assets: Map<number, Asset>;
  /** Those whose assets are known. */
  instances: Instance[];
}

/** Events of a `Connection`, by type, with their details. */
export interface ConnectionEvents {
  /** A scene begins, also a new version of it: discard everything before. */
  scene: CustomEvent<Scene>;
  asset: CustomEvent<Asset>;
  instances: CustomEvent<{ instances: Instance[] }>;
  /** The instances whose `drawn` has changed: some were replaced by others. */
  drawn: CustomEvent<{ instances: Instance[] }>;
  mesh: CustomEvent<MeshChange>;
  texture: CustomEvent<TextureChange>;
  tileremoved: CustomEvent<TileRemoved>;
  lights: CustomEvent<LightPage>;
  /** At least a coarse mesh of all that is visible has come. Once for each scene. */
  firstframe: CustomEvent<Model>;
  /** About ten times a second. */
  progress: CustomEvent<Stats>;
  /** All has come that the last view needs. */
  settled: CustomEvent<Stats>;
  /** The session has ended and is not tried again; the detail is for people. */
  error: CustomEvent<string>;
}

/** A session with a server. It reconnects by itself. */
export class Connection extends EventTarget {
  private constructor();
  readonly model: Model;
  /** Refines what a view shows. The same view again costs nothing. Throws a `TypeError` if it is none. */
  setView(view: View): void;
  setToken(token: string): void;
  /**
   * What a part is called: of the `instance`-th instance the `part`-th member of a batch, else 0. Asks the server once for
   * 256 neighbours. Rejects with the reason if that is not known.
   */
  part(instance: number, part?: number): Promise<PartInfo>;
  stats(): Stats;
  /** Ends the session and its worker. */
  close(): void;
  addEventListener<T extends keyof ConnectionEvents>(
    type: T,
    listener: (event: ConnectionEvents[T]) => void,
    options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject | null,
    options?: boolean | AddEventListenerOptions,
  ): void;
}

/**
 * Connects to `ws://host:port/scene` (or wss, http, https), or reads the published scene `https://host/path/NAME.lss`. Throws
 * a `TypeError` if that is no address.
 */
export function connect(src: string | URL, options?: ConnectOptions): Connection;

/**
 * `<lodestream-viewer src="ws://host:port/scene">`, or `src="https://host/path/NAME.lss"`. Further attributes: `scene` (in place of the address's), `token`,
 * `target-px` (error on the screen to refine to, by default 1), `memory` (most megabytes of heaps and GPU memory, by
 * default 512, on phones 256, at least 64), `camera` (`eye=x,y,z;target=x,y,z;up=x,y,z;fov=degrees`).
 * It has the attribute `shown` once there is a picture; until then, and without WebGPU, its children are shown. Events:
 * `firstframe`, `progress`, `settled` (detail: `Stats`) and `error` (detail: text). Removal ends the session and frees
 * worker and device. Styles reach the canvas as `::part(canvas)`.
 */
export class LodestreamViewer extends HTMLElement {
  /** Set before `src`. */
  webTransport: WebTransportAddress | null;
  /** The camera; null before the scene has begun. */
  get view(): Required<Camera> | null;
  set view(view: Camera);
  setView(view: Camera): void;
  /** Switches a technique: occlusion, shadows, relief, lights, water, haze, smoothing, adapt. */
  switch(technique: string, on: boolean): void;
  /**
   * What a part is called: of the `instance`-th instance the `part`-th member of a batch, else 0. Asks the server once for
   * 256 neighbours. Rejects with the reason if that is not known.
   */
  part(instance: number, part?: number): Promise<PartInfo>;
  /**
   * The part at a place of the element, in CSS pixels from its upper left corner; hidden parts are skipped. Where a proxy is
   * drawn, which knows instances only, the answer comes once the instance is, which may request it; null if that takes 20 s
   * or another part is asked for. Else nothing is sent.
   */
  pick(x: number, y: number): Promise<PickedPart | null>;
  /** Hides a part of a session's scene, or shows it again. */
  hide(instance: number, part: number, hidden?: boolean): void;
  /** Draws these parts alone; null ends that. */
  isolate(parts: ScenePart[] | null): void;
  /** Mixes `#rrggbb` into a part's colour, by a strength from 0 to 1 (by default 0.7); null ends that. */
  tint(instance: number, part: number, color: string | null, strength?: number): void;
  /**
   * Moves a part within its instance, in that one's units and axes, by a matrix of 16 numbers in columns, as three.js has
   * them; null moves it back. Throws if the matrix does more than move, turn and scale evenly.
   */
  move(instance: number, part: number, matrix: ArrayLike<number> | null): void;
  /** Moves the camera to a part; false if it has not arrived. */
  fit(instance: number, part: number): Promise<boolean>;
  /** Nothing hidden, tinted, moved or isolated. */
  showAll(): void;
  /** Null without a session. */
  stats(): Stats | null;
  /** The next frame as a PNG. */
  picture(): Promise<Blob>;
}

declare global {
  interface HTMLElementTagNameMap {
    'lodestream-viewer': LodestreamViewer;
  }
}
