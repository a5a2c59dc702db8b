// The mesh of an asset as whole arrays, kept up to date by the changes of its slots.

/** Components of the attributes and their types. */
const ATTRIBUTES = {
  positions: [3, Float32Array],
  normals: [3, Float32Array],
  uvs: [2, Float32Array],
  colors: [4, Uint16Array],
  parts: [1, Uint32Array],
};
/** Least elements of an array. */
const MIN_CAPACITY = 256;

/** The array itself if it fits `length` elements of `size` numbers, else a copy of twice as many as it has or needs. */
function fitted(array, length, size) {
  const capacity = array.length / size;
  if (capacity >= length && capacity <= Math.max(4 * length, MIN_CAPACITY)) return array;
  const other = new array.constructor(Math.max(length, 2 * Math.min(capacity, length), MIN_CAPACITY) * size);
  other.set(array.subarray(0, other.length));
  return other;
}

/** See `Mesh` in index.d.ts. */
export class Mesh {
  secondUvs = null;
  vertexCount = 0;
  indices = [];
  indexCounts = [];

  constructor(materials) {
    for (const [name, [, Type]] of Object.entries(ATTRIBUTES)) this[name] = new Type(0);
    for (let material = 0; material < materials; material += 1) {
      this.indices.push(new Uint32Array(0));
      this.indexCounts.push(0);
    }
  }

  /** Takes a change; whether arrays of vertices, and which lists of indices, were replaced by others. */
  apply({ vertices, faces, vertexCount, faceCounts }) {
    const before = this.positions;
    const secondBefore = this.secondUvs;
    this.vertexCount = vertexCount;
    for (const [name, [size]] of Object.entries(ATTRIBUTES)) {
      this[name] = fitted(this[name], vertexCount, size);
      for (const run of vertices) this[name].set(run[name], run.first * size);
    }
    this.#setSecondUvs(vertices);
    const indicesReplaced = [];
    faceCounts.forEach((count, material) => {
      const list = fitted(this.indices[material], 3 * count, 1);
      if (list !== this.indices[material]) indicesReplaced.push(material);
      this.indices[material] = list;
      this.indexCounts[material] = 3 * count;
    });
    for (const { material, first, indices } of faces) this.indices[material].set(indices, 3 * first);
    return { verticesReplaced: this.positions !== before || this.secondUvs !== secondBefore, indicesReplaced };
  }

  /** There is no array before a vertex has other coordinates than zero. */
  #setSecondUvs(runs) {
    if (this.secondUvs === null && runs.every((run) => run.secondUvs === null)) return;
    this.secondUvs = fitted(this.secondUvs ?? new Float32Array(0), this.vertexCount, 2);
    for (const { first, secondUvs, uvs } of runs) {
      if (secondUvs) this.secondUvs.set(secondUvs, first * 2);
      else this.secondUvs.fill(0, first * 2, first * 2 + uvs.length);
    }
  }
}
