// The camera that the reader moves: it turns about a target, and glides towards where it was told to go.
import { addScaled, cross, dot, normalize, projectionMatrix, subtract, viewMatrix } from "./matrix.js";

const STEEPEST = (89.5 * Math.PI) / 180;
const GLIDE_RATE = 16; // 1/s

export class Orbit {
  // camera: { eye, target, up, fov, aspect }; bounds: { center, radius } of the asset.
  constructor(camera, bounds) {
    this.bounds = bounds;
    this.home = camera;
    this.lookAt(camera);
  }

  lookAt({ eye, target, up, fov, aspect }) {
    const previous = this.frame ?? this.home;
    this.frame = { up: normalize(up ?? previous.up), fov: fov ?? previous.fov, aspect: aspect ?? previous.aspect };
    const axis = this.frame.up;
    const helper = Math.abs(axis[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1];
    this.ahead = normalize(cross(helper, axis)); // +z when up is +y
    this.side = cross(axis, this.ahead);
    const away = subtract(eye, target);
    const back = normalize(away);
    this.goal = {
      azimuth: Math.atan2(dot(back, this.side), dot(back, this.ahead)),
      elevation: Math.asin(Math.min(1, Math.max(-1, dot(back, axis)))),
      distance: Math.hypot(...away),
      target: [...target],
    };
    this.arrive();
  }

  arrive() {
    this.shown = { ...this.goal, target: [...this.goal.target] };
  }

  // Moves what is shown towards the goal; false once it has arrived.
  glide(seconds) {
    const share = 1 - Math.exp(-GLIDE_RATE * seconds);
    const { shown, goal } = this;
    const logarithm = Math.log(goal.distance / shown.distance);
    const gap = subtract(goal.target, shown.target);
    const left =
      Math.abs(goal.azimuth - shown.azimuth) +
      Math.abs(goal.elevation - shown.elevation) +
      Math.abs(logarithm) +
      Math.hypot(...gap) / shown.distance;
    if (left < 1e-4) {
      this.arrive();
      return false;
    }
    shown.azimuth += share * (goal.azimuth - shown.azimuth);
    shown.elevation += share * (goal.elevation - shown.elevation);
    shown.distance *= Math.exp(share * logarithm);
    shown.target = addScaled(shown.target, gap, share);
    return true;
  }

  turn(azimuth, elevation) {
    this.goal.azimuth += azimuth;
    this.goal.elevation = Math.min(STEEPEST, Math.max(-STEEPEST, this.goal.elevation + elevation));
  }

  zoom(factor) {
    const { radius } = this.bounds;
    this.goal.distance = Math.min(50 * radius, Math.max(0.02 * radius, this.goal.distance * factor));
  }

  // dx, dy: how far the target should move in the picture; free: as for `matrices`.
  pan(dx, dy, free) {
    const back = this.back(this.goal);
    const right = normalize(cross(this.frame.up, back));
    const above = cross(back, right);
    const step = (2 * this.goal.distance * this.tangent(free)) / free.height;
    this.goal.target = addScaled(addScaled(this.goal.target, right, -dx * step), above, dy * step);
  }

  // Of half the vertical field of view: wider than authored where that fits the authored width in.
  tangent(free) {
    const authored = Math.tan((this.frame.fov * Math.PI) / 360);
    return authored * Math.max(1, (this.frame.aspect * free.height) / free.width);
  }

  // Where the camera goes: { eye, target }.
  camera() {
    const { distance, target } = this.goal;
    return { eye: addScaled(target, this.back(this.goal), distance), target: [...target] };
  }

  back({ azimuth, elevation }) {
    const flat = addScaled([0, 0, 0], this.side, Math.sin(azimuth) * Math.cos(elevation));
    const forth = addScaled(flat, this.ahead, Math.cos(azimuth) * Math.cos(elevation));
    return addScaled(forth, this.frame.up, Math.sin(elevation));
  }

  // The authored frame, whole, inside the free part of the picture; `free` is { x, y, width, height } from
  // its top left, in the same unit as the picture's width and height.
  matrices(width, height, free) {
    const back = this.back(this.shown);
    const eye = addScaled(this.shown.target, back, this.shown.distance);
    const { center, radius } = this.bounds;
    const depth = dot(subtract(eye, center), back);
    const far = Math.max(depth + radius, radius * 1e-3) * 1.01;
    const near = Math.max((depth - radius) * 0.99, far * 1e-4);
    const projection = projectionMatrix(this.tangent(free), free.width / free.height, near, far);
    const scale = [free.width / width, free.height / height];
    const shift = [(2 * free.x + free.width) / width - 1, 1 - (2 * free.y + free.height) / height];
    for (const row of [0, 1]) {
      for (let i = 0; i < 4; i++) {
        projection[4 * row + i] = projection[4 * row + i] * scale[row] + projection[12 + i] * shift[row];
      }
    }
    return { view: viewMatrix(eye, back, this.frame.up), projection };
  }
}
