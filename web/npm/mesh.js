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

/** The array itself if it has `length` elements of `size` numbers, else a copy that has at least twice as many. */
function grown(array, length, size) {
  if (array.length >= length * size) return array;
  const larger = new array.constructor(Math.max(length, (2 * array.length) / size, MIN_CAPACITY) * size);
  larger.set(array);
  return larger;
}

/** See `Mesh` in index.d.ts. */
export class Mesh {
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

  /** Takes a change; whether arrays of vertices, and which lists of indices, were replaced by longer ones. */
  apply({ vertices, faces }) {
    const before = this.positions;
    for (const run of vertices) {
      const end = run.first + run.positions.length / 3;
      this.vertexCount = Math.max(this.vertexCount, end);
      for (const [name, [size]] of Object.entries(ATTRIBUTES)) {
        this[name] = grown(this[name], end, size);
        this[name].set(run[name], run.first * size);
      }
    }
    const replaced = new Set();
    for (const { material, first, indices } of faces) {
      const end = 3 * first + indices.length;
      const list = grown(this.indices[material], end, 1);
      if (list !== this.indices[material]) replaced.add(material);
      list.set(indices, 3 * first);
      this.indices[material] = list;
      this.indexCounts[material] = Math.max(this.indexCounts[material], end);
    }
    return { verticesReplaced: this.positions !== before, indicesReplaced: [...replaced] };
  }
}
