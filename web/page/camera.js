// Cameras as text and as numbers: eye, target, up, vertical field of view in radians.

/** Ten numbers of a camera in parts `eye`, `target`, `up` (`x,y,z`) and `fov` (degrees), or null if it is none. */
export function cameraOf({ eye, target, up = '0,1,0', fov = '50' }) {
  if (!eye || !target) return null;
  const numbers = [eye, target, up].flatMap((point) => point.split(',').map(Number));
  numbers.push((Number(fov) * Math.PI) / 180);
  return numbers.length === 10 && numbers.every(Number.isFinite) ? numbers : null;
}
