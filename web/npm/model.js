// What has been received of a scene: assets with their meshes, instances and textures.

import { Mesh } from './mesh.js';

/** Side of tiles of textures, and their border on each side, in texels; as crates/scene/src/asset/tiles.rs has them. */
const TILE_SIDE = 256;
const TILE_BORDER = 2;

/** Product of a rotation (unit quaternion) and a scale, and the image of a point under it, as a matrix by columns. */
function matrixOf([x, y, z, w], scale, translation, origin, relativeTo) {
  const columns = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ].map((column) => column.map((number) => number * scale));
  const moved = [0, 1, 2].map(
    (row) =>
      translation[row] - relativeTo[row] + columns.reduce((sum, column, axis) => sum + column[row] * origin[axis], 0),
  );
  return Float64Array.from([...columns.flatMap((column) => [...column, 0]), ...moved, 1]);
}

/** The texels that a tile of a level covers. */
function tilePlace(tile, level) {
  const columns = Math.ceil(level.width / TILE_SIDE);
  const [x, y] = [(tile % columns) * TILE_SIDE, Math.floor(tile / columns) * TILE_SIDE];
  return { x, y, width: Math.min(TILE_SIDE, level.width - x), height: Math.min(TILE_SIDE, level.height - y) };
}

/** The texels (RGBA) of a tile of this size, from its image with a border. */
function withoutBorder(image, width, height) {
  const [row, rowOfImage] = [4 * width, 4 * (width + 2 * TILE_BORDER)];
  const texels = new Uint8Array(row * height);
  for (let y = 0; y < height; y += 1) {
    const first = (y + TILE_BORDER) * rowOfImage + 4 * TILE_BORDER;
    texels.set(image.subarray(first, first + row), y * row);
  }
  return texels;
}

/** See `Model` in index.d.ts. */
export class Model {
  scene = null;
  assets = new Map();
  instances = [];
  /** Instances whose assets have not arrived, by asset. */
  #waiting = new Map();
  #instanceCount = 0;
  /** Placements of proxies by number, and what is drawn, if there are proxies. */
  #proxies = [];
  #cut = null;
  #relativeTo;

  constructor(relativeTo) {
    this.#relativeTo = relativeTo;
  }

  /** Takes a change from the worker; gives the events that tell it, as pairs of type and detail. */
  apply(delta) {
    const { kind, ...detail } = delta;
    return this[`_${kind}`](detail);
  }

  _scene(scene) {
    this.scene = scene;
    this.assets.clear();
    this.instances = [];
    this.#waiting.clear();
    this.#instanceCount = 0;
    this.#proxies = [];
    this.#cut = null;
    return [['scene', scene]];
  }

  _lights(page) {
    return [['lights', page]];
  }

  _firstframe() {
    return [['firstframe', this]];
  }

  _instances({ assets, translations, rotations, scales }) {
    const known = [];
    for (let at = 0; at < assets.length; at += 1) {
      const instance = {
        index: this.#instanceCount,
        asset: assets[at],
        translation: translations.subarray(3 * at, 3 * at + 3),
        rotation: rotations.subarray(4 * at, 4 * at + 4),
        scale: scales[at],
      };
      this.#instanceCount += 1;
      this.#add(instance, known);
    }
    return known.length ? [['instances', { instances: known }]] : [];
  }

  /** Places an instance, or keeps it until its asset comes. */
  #add(instance, known) {
    if (this.assets.has(instance.asset)) {
      known.push(this.#place(instance));
    } else {
      const others = this.#waiting.get(instance.asset) ?? [];
      others.push(instance);
      this.#waiting.set(instance.asset, others);
    }
  }

  _proxies({ assets }) {
    const known = [];
    for (const asset of assets) {
      const proxy = { index: null, proxy: this.#proxies.length, asset, translation: [0, 0, 0], rotation: [0, 0, 0, 1], scale: 1 };
      this.#proxies.push(asset);
      this.#add(proxy, known);
    }
    this.#cut ??= { proxies: new Set(), instances: 0, covered: [] };
    return known.length ? [['instances', { instances: known }]] : [];
  }

  _cut({ proxies, instances, covered }) {
    this.#cut = { proxies: new Set(proxies), instances, covered };
    const changed = this.instances.filter((instance) => instance.drawn !== this.#isDrawn(instance));
    for (const instance of changed) instance.drawn = !instance.drawn;
    return changed.length ? [['drawn', { instances: changed }]] : [];
  }

  #isDrawn({ index, proxy }) {
    if (!this.#cut) return true;
    if (proxy !== null) return this.#cut.proxies.has(proxy);
    if (index >= this.#cut.instances) return false;
    // The run that begins last at or before the instance.
    const { covered } = this.#cut;
    let [low, high] = [0, covered.length / 2];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (covered[2 * middle] <= index) low = middle + 1;
      else high = middle;
    }
    return low === 0 || index >= covered[2 * low - 1];
  }

  #place({ index, proxy = null, asset, translation, rotation, scale }) {
    const { origin } = this.assets.get(asset);
    const matrix = matrixOf(rotation, scale, translation, origin, this.#relativeTo);
    const instance = { index, proxy, asset, matrix, drawn: true };
    instance.drawn = this.#isDrawn(instance);
    this.instances.push(instance);
    return instance;
  }

  _asset(asset) {
    asset.mesh = new Mesh(asset.materials.length);
    this.assets.set(asset.asset, asset);
    const instances = (this.#waiting.get(asset.asset) ?? []).map((instance) => this.#place(instance));
    this.#waiting.delete(asset.asset);
    const events = [['asset', asset]];
    if (instances.length) events.push(['instances', { instances }]);
    return events;
  }

  _mesh({ asset, ...change }) {
    const { mesh } = this.assets.get(asset);
    const { vertices, faces } = change;
    return [['mesh', { asset, mesh, ...mesh.apply(change), vertices, faces }]];
  }

  _texture(texture) {
    const level = this.assets.get(texture.asset).textures[texture.texture].levels[texture.level];
    if (texture.tile === null) return [['texture', { ...texture, x: 0, y: 0, ...level }]];
    const place = tilePlace(texture.tile, level);
    const texels = withoutBorder(texture.texels, place.width, place.height);
    return [['texture', { ...texture, ...place, texels }]];
  }

  _tileRemoved(tile) {
    return [['tileremoved', tile]];
  }
}
