// Texture levels: files in, pictures out, by the browser's own decoders.

const PNG_SIGNATURE = 8;

/**
 * Decodes a picture of `Streamer.pictures()`. Gives what the page holds: `bitmap`, or `texels` of `bits` each; of planes
 * the picture's pixels, in place of the texels that `Streamer.texels()` makes of them. The header of the file was compared
 * with `width` and `height`; the result is again.
 */
export async function decode({ file, width, height, height_map: isHeights, planes }) {
  if (isHeights) return decodeHeights(file, width, height);
  const bitmap = await createImageBitmap(new Blob([file]), { colorSpaceConversion: 'none', premultiplyAlpha: 'none' });
  const [columns, rows] = [bitmap.width, bitmap.height];
  if (columns === width && rows === height) return planes ? { texels: await pixelsOf(bitmap), bits: 32 } : { bitmap };
  bitmap.close();
  throw new Error(`the image has ${columns}×${rows} pixels`);
}

/** The pixels of a grey picture, four bytes each. Not by a canvas: where those could identify a user, their pixels differ. */
async function pixelsOf(bitmap) {
  const { width, height } = bitmap;
  const frame = new VideoFrame(bitmap, { timestamp: 0 });
  bitmap.close();
  try {
    const pixels = new Uint8Array(4 * width * height);
    if (frame.allocationSize() !== pixels.length) throw new Error(`pixels of the format ${frame.format}`);
    await frame.copyTo(pixels, { layout: [{ offset: 0, stride: 4 * width }] });
    return pixels;
  } finally {
    frame.close();
  }
}

/** The texels of a grey PNG (ISO/IEC 15948) of 8 or 16 bits: pictures of the browser have 8. */
async function decodeHeights(file, width, height) {
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  const parts = [];
  let header = null;
  for (let at = PNG_SIGNATURE; at + 12 <= file.length; ) {
    const length = view.getUint32(at);
    const name = String.fromCharCode(...file.subarray(at + 4, at + 8));
    if (at + 12 + length > file.length) break;
    if (name === 'IHDR' && length === 13) header = file.subarray(at + 16, at + 21);
    if (name === 'IDAT') parts.push(file.subarray(at + 8, at + 8 + length));
    at += 12 + length;
  }
  const [bits, colour, , , interlaced] = header ?? [];
  if (![8, 16].includes(bits) || colour !== 0 || interlaced !== 0) throw new Error('it is no grey PNG of 8 or 16 bits');
  const pixel = bits / 8;
  const rows = await inflate(parts, height * (1 + width * pixel));
  return { texels: unfilter(rows, height, width * pixel, pixel), bits };
}

/** Inflates exactly `length` bytes; more or fewer are an error. */
async function inflate(parts, length) {
  const stream = new Blob(parts).stream().pipeThrough(new DecompressionStream('deflate'));
  const out = new Uint8Array(length);
  let filled = 0;
  for (const reader = stream.getReader(); ; ) {
    const { value, done } = await reader.read();
    if (done) break;
    if (filled + value.length > length) {
      await reader.cancel();
      throw new Error('it has more texels than its header says');
    }
    out.set(value, filled);
    filled += value.length;
  }
  if (filled < length) throw new Error('it has fewer texels than its header says');
  return out;
}

/** Undoes the filter of each row (clause 9), and turns 16-bit texels to little-endian. */
function unfilter(rows, height, stride, pixel) {
  const out = new Uint8Array(height * stride);
  for (let y = 0; y < height; y += 1) {
    const from = y * (stride + 1) + 1;
    const to = y * stride;
    const filter = rows[from - 1];
    if (filter > 4) throw new Error(`row ${y} has the unknown filter ${filter}`);
    for (let x = 0; x < stride; x += 1) {
      const left = x >= pixel ? out[to + x - pixel] : 0;
      const up = y > 0 ? out[to + x - stride] : 0;
      const corner = x >= pixel && y > 0 ? out[to + x - stride - pixel] : 0;
      out[to + x] = rows[from + x] + [0, left, up, (left + up) >> 1, paeth(left, up, corner)][filter];
    }
  }
  if (pixel === 2) {
    for (let at = 0; at < out.length; at += 2) [out[at], out[at + 1]] = [out[at + 1], out[at]];
  }
  return out;
}

function paeth(left, up, corner) {
  const [a, b, c] = [left, up, corner].map((value) => Math.abs(left + up - corner - value));
  if (a <= b && a <= c) return left;
  return b <= c ? up : corner;
}
