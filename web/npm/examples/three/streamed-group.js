// A streamed scene as a group of three.js: its meshes are refined in place while the camera comes nearer.

import * as THREE from 'three';
import { connect } from 'lodestream/connect';
import { Texels } from './texels.js';

const WRAP = {
  repeat: THREE.RepeatWrapping,
  clamp: THREE.ClampToEdgeWrapping,
  mirror: THREE.MirroredRepeatWrapping,
};
/** Texels that are drawn until the first level of a texture has arrived, by the kind of texture. */
const UNKNOWN = { color: [255, 255, 255], surface: [255, 255, 255], normal: [128, 128, 255] };
/** Texels that are uploaded per frame, on average: three uploads whole textures. */
const FRAME_TEXELS = 1 << 22;
/** Attributes of three's geometries: array of the mesh, numbers for each vertex, whether 65535 is 1. */
const ATTRIBUTES = {
  position: ['positions', 3, false],
  normal: ['normals', 3, false],
  uv: ['uvs', 2, false],
  uv1: ['secondUvs', 2, false],
  color: ['colors', 4, true],
};

/** An asset: an instanced mesh for each material; all have the same vertices. */
class Asset {
  #asset;
  #group;
  #materials;
  #textures;
  #meshes = [];
  #geometries = [];
  #instances = [];
  #matrices = [];

  constructor(asset, group) {
    this.#asset = asset;
    this.#group = group;
    this.#textures = asset.textures.map((info) => firstTexture(info));
    this.#materials = asset.materials.map((material) => materialOf(material, asset.textures, this.#textures));
    this.#build();
  }

  /** Makes geometries of the mesh's present arrays: after those were replaced, the old ones' buffers are freed. */
  #build() {
    const { mesh, center, radius } = this.#asset;
    for (const geometry of this.#geometries) geometry.dispose();
    const present = Object.entries(ATTRIBUTES).filter(([, [array]]) => mesh[array] !== null);
    const attributes = present.map(([name, [array, size, normalized]]) => {
      const attribute = new THREE.BufferAttribute(mesh[array], size, normalized);
      return [name, attribute.setUsage(THREE.DynamicDrawUsage)];
    });
    this.#geometries = mesh.indices.map((indices, material) => {
      const geometry = new THREE.BufferGeometry();
      for (const [name, attribute] of attributes) geometry.setAttribute(name, attribute);
      geometry.setIndex(new THREE.BufferAttribute(indices, 1).setUsage(THREE.DynamicDrawUsage));
      geometry.setDrawRange(0, mesh.indexCounts[material]);
      geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(...center), radius);
      return geometry;
    });
    this.#meshes.forEach((instanced, material) => (instanced.geometry = this.#geometries[material]));
  }

  /** Shows a change of the mesh: uploads what has changed, or all of it where arrays are new. */
  update({ mesh, vertices, faces, verticesReplaced, indicesReplaced }) {
    if (verticesReplaced || indicesReplaced.length) return this.#build();
    for (const [name, [array, size]] of Object.entries(ATTRIBUTES)) {
      const attribute = this.#geometries[0].attributes[name];
      for (const run of attribute ? vertices : []) {
        attribute.addUpdateRange(size * run.first, size * run.parts.length);
        attribute.needsUpdate = true;
      }
    }
    for (const { material, first, indices } of faces) {
      const geometry = this.#geometries[material];
      geometry.index.addUpdateRange(3 * first, indices.length);
      geometry.index.needsUpdate = true;
    }
    // Lists become shorter, too.
    this.#geometries.forEach((geometry, material) => geometry.setDrawRange(0, mesh.indexCounts[material]));
  }

  /** Adds instances, and places those that are drawn. */
  place(instances) {
    this.#instances.push(...instances);
    this.#matrices = this.#instances.filter(({ drawn }) => drawn).map(({ matrix }) => matrix);
    this.#removeMeshes();
    if (!this.#matrices.length) return;
    this.#meshes = this.#materials.map((material, at) => {
      const instanced = new THREE.InstancedMesh(this.#geometries[at], material, this.#matrices.length);
      this.#matrices.forEach((matrix, index) => instanced.setMatrixAt(index, new THREE.Matrix4().fromArray(matrix)));
      instanced.castShadow = instanced.receiveShadow = true;
      this.#group.add(instanced);
      return instanced;
    });
  }

  #removeMeshes() {
    for (const instanced of this.#meshes) {
      instanced.removeFromParent();
      instanced.dispose();
    }
    this.#meshes = [];
  }

  /** Takes a level of a texture or a tile; the texture, if it is to be uploaded. */
  texture(change) {
    const texture = this.#textures[change.texture];
    const size = this.#asset.textures[change.texture].levels[change.level];
    return texture?.userData.texels.put(change, size) ? texture : null;
  }

  /** Faces that are drawn, for each instance. */
  get faces() {
    const { indices, indexCounts } = this.#asset.mesh;
    let faces = 0;
    indices.forEach((list, material) => {
      for (let at = 0; at < indexCounts[material]; at += 3) if (list[at] !== list[at + 1]) faces += 1;
    });
    return faces;
  }

  dispose() {
    this.#removeMeshes();
    for (const item of [...this.#geometries, ...this.#materials, ...this.#textures]) item?.dispose();
  }
}

/** A texture of one texel. None for heights: three's materials have no relief. */
function firstTexture({ kind, mean }) {
  if (kind === 'height') return null;
  const texels = new Texels([...(mean ?? UNKNOWN[kind]), 255]);
  const texture = new THREE.DataTexture(texels.data, 1, 1);
  texture.colorSpace = kind === 'color' ? THREE.SRGBColorSpace : THREE.NoColorSpace;
  texture.magFilter = THREE.LinearFilter;
  texture.minFilter = THREE.LinearMipmapLinearFilter;
  texture.generateMipmaps = true;
  texture.anisotropy = 4;
  // Texels begin at the top, texture coordinates at the bottom.
  texture.flipY = true;
  texture.userData.texels = texels;
  texture.needsUpdate = true;
  return texture;
}

/** Has a texture uploaded with the next picture; the number of its texels. */
function upload(texture) {
  const { width, height, data } = texture.userData.texels;
  if (data.buffer !== texture.image.data.buffer) {
    // Another size needs another texture of the device.
    texture.dispose();
    texture.image = { data, width, height };
  }
  texture.needsUpdate = true;
  return width * height;
}

/** A material of three.js for one of the scene. */
function materialOf(material, infos, textures) {
  const texture = (name) => {
    const found = material[name] === null ? null : textures[material[name]];
    if (found) found.channel = material.secondUv.includes(name) ? 1 : 0;
    if (found) [found.wrapS, found.wrapT] = material.wrap.map((wrap) => WRAP[wrap]);
    return found;
  };
  const [red, green, blue, opacity] = material.baseColor;
  const common = {
    name: material.name,
    color: new THREE.Color(red, green, blue),
    opacity,
    map: texture('baseColorTexture'),
    vertexColors: true,
    transparent: material.alphaMode === 'blend',
    alphaTest: material.alphaMode === 'mask' ? material.alphaCutoff : 0,
    side: THREE.DoubleSide,
  };
  if (material.unlit) return new THREE.MeshBasicMaterial(common);
  const surface = texture('surfaceTexture');
  return new THREE.MeshStandardMaterial({
    ...common,
    flatShading: material.flat,
    roughness: material.roughness,
    metalness: material.metallic,
    emissive: new THREE.Color(...material.emission),
    emissiveMap: texture('emissionTexture'),
    aoMap: texture('occlusionTexture') ?? surface,
    roughnessMap: surface,
    metalnessMap: surface,
    normalMap: texture('normalTexture'),
    normalScale: new THREE.Vector2(material.normalScale, material.normalScale),
  });
}

/** A scene from a server. Its `connection` has the events; `follow` asks for what a camera sees. */
export class StreamedGroup extends THREE.Group {
  #assets = new Map();
  /** Textures to upload, and how many texels may be. */
  #changed = new Set();
  #texels = 0;
  #relativeTo;

  /** `options`: those of `connect`; the group's axes are the scene's, moved to `relativeTo`. */
  constructor(src, options = {}) {
    super();
    this.#relativeTo = options.relativeTo ?? [0, 0, 0];
    this.connection = connect(src, options);
    const on = (type, act) => this.connection.addEventListener(type, ({ detail }) => act(detail));
    on('scene', () => this.#clear());
    on('asset', (asset) => this.#assets.set(asset.asset, new Asset(asset, this)));
    on('mesh', (change) => this.#assets.get(change.asset).update(change));
    on('texture', (change) => {
      const texture = this.#assets.get(change.asset).texture(change);
      if (texture) this.#changed.add(texture);
    });
    on('instances', ({ instances }) => {
      const byAsset = Map.groupBy(instances, ({ asset }) => asset);
      for (const [asset, list] of byAsset) this.#assets.get(asset).place(list);
    });
    // Distant instances are drawn as proxies.
    on('drawn', ({ instances }) => {
      for (const asset of new Set(instances.map(({ asset }) => asset))) this.#assets.get(asset).place([]);
    });
    this.addEventListener('removed', () => this.dispose());
  }

  /**
   * Refines what a camera sees in a picture of a size, in pixels of the device, and shows new texels. For each frame; cheap
   * where nothing has changed.
   */
  follow(camera, { x: width, y: height }, targetPx = 1) {
    this.updateWorldMatrix(true, false);
    camera.updateWorldMatrix(true, false);
    const [eye, rotation] = [new THREE.Vector3(), new THREE.Quaternion()];
    const seen = new THREE.Matrix4().copy(this.matrixWorld).invert().multiply(camera.matrixWorld);
    seen.decompose(eye, rotation, new THREE.Vector3());
    this.connection.setView({
      eye: eye.toArray().map((number, axis) => number + this.#relativeTo[axis]),
      rotation: rotation.toArray(),
      fov: camera.getEffectiveFOV(),
      width,
      height,
      targetPx,
    });
    this.#upload();
  }

  /** Uploads some of the changed textures. Large ones use up the texels of several frames. */
  #upload() {
    this.#texels = Math.min(this.#texels, 0) + FRAME_TEXELS;
    for (const texture of this.#changed) {
      if (this.#texels <= 0) break;
      this.#changed.delete(texture);
      this.#texels -= upload(texture);
    }
  }

  /** Faces of all assets. */
  get faces() {
    return [...this.#assets.values()].reduce((sum, asset) => sum + asset.faces, 0);
  }

  #clear() {
    for (const asset of this.#assets.values()) asset.dispose();
    this.#assets.clear();
    this.#changed.clear();
  }

  /** Ends the session and frees the device's memory; also done when the group is removed from its parent. */
  dispose() {
    this.connection.close();
    this.#clear();
  }
}
