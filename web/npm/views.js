// Views as numbers for the streamer: eye, rotation, vertical field of view, size of the picture, screen error.

const subtract = (a, b) => a.map((number, axis) => number - b[axis]);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const length = (vector) => Math.hypot(...vector);
const unit = (vector) => vector.map((number) => number / length(vector));

/** The unit quaternion x, y, z, w that turns the axes to these (Shepperd 1978: from its largest part). */
function quaternionOf(x, y, z) {
  const parts = [x[0] - y[1] - z[2], y[1] - x[0] - z[2], z[2] - x[0] - y[1], x[0] + y[1] + z[2]];
  // Four times the products of two parts of the quaternion, and of each with itself.
  const products = [
    [1 + parts[0], x[1] + y[0], x[2] + z[0], y[2] - z[1]],
    [x[1] + y[0], 1 + parts[1], y[2] + z[1], z[0] - x[2]],
    [x[2] + z[0], y[2] + z[1], 1 + parts[2], x[1] - y[0]],
    [y[2] - z[1], z[0] - x[2], x[1] - y[0], 1 + parts[3]],
  ];
  return unit(products[parts.indexOf(Math.max(...parts))]);
}

/** The rotation of a view from `eye` towards `target`, with `up` roughly up. */
function rotationOf(eye, target, up) {
  const back = unit(subtract(eye, target));
  let right = cross(up, back);
  // Any other axis where they align.
  if (length(right) < 1e-5) right = cross([0.36, 0.48, 0.8], back);
  right = unit(right);
  return quaternionOf(right, cross(back, right), back);
}

/** The numbers of a `View` (index.d.ts). Throws if it is none. */
export function numbersOf({ eye, rotation, target, up = [0, 1, 0], fov = 50, width, height, targetPx = 1 }) {
  const turned = rotation ?? rotationOf(eye, target, up);
  const numbers = [...eye, ...turned, (fov * Math.PI) / 180, Math.round(width), Math.round(height), targetPx];
  if (numbers.length !== 11 || !numbers.every(Number.isFinite)) {
    throw new TypeError('a view needs eye, width, height, and rotation or a target other than the eye');
  }
  return Float64Array.from(numbers);
}
