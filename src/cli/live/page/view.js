// Moving a camera that looks at a point: turned about it, shifted with it, brought nearer to it.

const add = (a, b) => a.map((x, i) => x + b[i]);
const sub = (a, b) => a.map((x, i) => x - b[i]);
const scale = (a, s) => a.map((x) => x * s);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.sqrt(dot(a, a));
const unit = (a) => scale(a, 1 / Math.max(length(a), 1e-12));

// Rodrigues' rotation of a vector about a unit axis.
const turned = (v, axis, angle) => {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  return add(add(scale(v, c), scale(cross(axis, v), s)), scale(axis, dot(axis, v) * (1 - c)));
};

const NEAREST_TO_POLE = 0.02;

// Turns by angles to the right and upwards; the camera never passes over a pole, where its `up` would have no meaning.
export function orbit({ position, look_at, up }, right, upwards) {
  const axis = unit(up);
  let arm = turned(sub(position, look_at), axis, -right);
  const height = Math.acos(Math.min(1, Math.max(-1, dot(unit(arm), axis))));
  const wanted = Math.min(Math.PI - NEAREST_TO_POLE, Math.max(NEAREST_TO_POLE, height - upwards));
  const side = cross(axis, arm);
  if (length(side) > 1e-9) arm = turned(arm, unit(side), wanted - height);
  return { position: add(look_at, arm), look_at, up };
}

// Shifts by fractions of the distance, to the right and upwards as the camera sees it.
export function pan({ position, look_at, up }, right, upwards) {
  const forward = sub(look_at, position);
  const side = unit(cross(forward, up));
  const over = unit(cross(side, forward));
  const way = scale(add(scale(side, right), scale(over, upwards)), length(forward));
  return { position: add(position, way), look_at: add(look_at, way), up };
}

// Multiplies the distance.
export function dolly({ position, look_at, up }, factor) {
  const arm = scale(sub(position, look_at), factor);
  return length(arm) < 1e-6 ? { position, look_at, up } : { position: add(look_at, arm), look_at, up };
}
