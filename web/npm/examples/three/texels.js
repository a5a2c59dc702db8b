// The texels that are shown of a streamed texture: the finest that have arrived at each place, enlarged to one size.

/** Most texels of a side: finer levels are left out. */
const MAX_SIDE = 4096;
/** Side of the cells for which it is known how fine they are: that of tiles. */
const CELL = 256;

/** The texel of a side of `from` texels that is nearest to a texel of a side of `to`. */
const nearest = (texel, from, to) => Math.floor(((2 * texel + 1) * from) / (2 * to));
/** The first texel of a side of `to` to which `texel`, or a later one, is the nearest. */
const firstOf = (texel, from, to) => Math.max(Math.ceil((2 * texel * to - from) / (2 * from)), 0);

export class Texels {
  level = -1;
  width = 1;
  height = 1;
  /** One number for each, of the bytes RGBA; rows from the top. */
  #texels;
  /** The level that each cell shows, row by row. */
  #levels = Int8Array.of(-1);

  /** One texel, until the first level arrives. */
  constructor(rgba) {
    this.#texels = new Uint32Array(Uint8Array.from(rgba).buffer);
  }

  get data() {
    return new Uint8Array(this.#texels.buffer);
  }

  /** Takes a level, or a tile of one, of this size; whether something of it is shown. */
  put({ level, x, y, width, height, texels }, size) {
    if (Math.max(size.width, size.height) > MAX_SIDE) return false;
    if (level > this.level) this.#enlarge(level, size);
    const image = { x, y, width, size, texels: new Uint32Array(texels.buffer, texels.byteOffset, width * height) };
    const [left, right] = [x, x + width].map((texel) => firstOf(texel, size.width, this.width));
    const [top, bottom] = [y, y + height].map((texel) => firstOf(texel, size.height, this.height));
    let isShown = false;
    for (const cell of this.#cells()) {
      if (this.#levels[cell.at] > level) continue;
      const [fromX, toX] = [Math.max(cell.left, left), Math.min(cell.right, right)];
      const [fromY, toY] = [Math.max(cell.top, top), Math.min(cell.bottom, bottom)];
      if (fromX >= toX || fromY >= toY) continue;
      this.#copy(image, fromX, fromY, toX, toY);
      // Sides are halved and rounded down, so a cell's outermost texel may belong to the next tile of a coarser level.
      const { x, y } = cell.middle;
      if (fromX <= x && x < toX && fromY <= y && y < toY) this.#levels[cell.at] = level;
      isShown = true;
    }
    return isShown;
  }

  *#cells() {
    let at = 0;
    for (let top = 0; top < this.height; top += CELL) {
      const bottom = Math.min(top + CELL, this.height);
      for (let left = 0; left < this.width; left += CELL) {
        const right = Math.min(left + CELL, this.width);
        yield { at, left, top, right, bottom, middle: { x: (left + right) >> 1, y: (top + bottom) >> 1 } };
        at += 1;
      }
    }
  }

  /** Takes the size of a finer level. */
  #enlarge(level, size) {
    const { width, height } = this;
    const [levels, columns] = [this.#levels, Math.ceil(width / CELL)];
    const shown = { x: 0, y: 0, width, size: { width, height }, texels: this.#texels };
    Object.assign(this, { level, width: size.width, height: size.height });
    this.#texels = new Uint32Array(this.width * this.height);
    this.#copy(shown, 0, 0, this.width, this.height);
    const cellOf = (texel, from, to) => Math.floor(nearest(texel, from, to) / CELL);
    this.#levels = Int8Array.from(this.#cells(), ({ middle: { x, y } }) =>
      levels[cellOf(y, height, this.height) * columns + cellOf(x, width, this.width)]);
  }

  /** Fills a rectangle from an image that covers it. */
  #copy({ x, y, width, size, texels }, left, top, right, bottom) {
    const columns = Uint16Array.from({ length: right - left }, (_, at) => nearest(left + at, size.width, this.width) - x);
    const [target, count] = [this.#texels, columns.length];
    for (let row = top; row < bottom; row += 1) {
      const from = (nearest(row, size.height, this.height) - y) * width;
      const to = row * this.width + left;
      for (let at = 0; at < count; at += 1) target[to + at] = texels[from + columns[at]];
    }
  }
}
