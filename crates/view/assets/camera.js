const add = (a, b) => a.map((x, i) => x + b[i]);
const minus = (a, b) => a.map((x, i) => x - b[i]);
const times = (a, s) => a.map((x) => x * s);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.hypot(...a);
const unit = (a) => times(a, 1 / (norm(a) || 1));

/** Turns `v` about the unit `axis` by `angle` (Rodrigues). */
function turned(v, axis, angle) {
  const c = Math.cos(angle), s = Math.sin(angle);
  return add(add(times(v, c), times(cross(axis, v), s)), times(axis, dot(axis, v) * (1 - c)));
}

/** Angle beyond that of the outermost training camera, in radians, up to which a forward-facing scene can be turned. */
const MARGIN = 0.2;

/**
 * Pinhole camera that is moved by hand: `eye`, its axes `right`, `up` and `back` in the world, and the `target` that it turns
 * about. `lens` belongs to an image of `size`, which is fitted into the canvas.
 */
class Camera {
  constructor(scene) {
    this.scene = scene;
    this.world = unit(scene.up);
    if (!scene.forward) return;
    const backs = scene.cameras.map((camera) => unit(camera.pose.slice(8, 11)));
    this.middle = unit(backs.reduce(add));
    this.limit = MARGIN + Math.max(...backs.map((back) => this.offMiddle(back)));
  }

  /** Angle of an axis to the mean of the training cameras' axes. */
  offMiddle(back) {
    return Math.acos(Math.max(-1, Math.min(1, dot(back, this.middle))));
  }

  /** Takes the pose and lens of a training camera, and turns about what it sees nearest to the scene's centre. */
  take({ pose, lens, width, height }) {
    [this.right, this.up, this.back] = [0, 4, 8].map((i) => unit(pose.slice(i, i + 3)));
    this.eye = pose.slice(12, 15);
    this.lens = lens;
    this.size = [width, height];
    const ahead = -dot(minus(this.scene.centre, this.eye), this.back);
    const distance = ahead > 0.05 * this.scene.radius ? ahead : this.scene.radius;
    this.target = minus(this.eye, times(this.back, distance));
  }

  /** Movable state, for another scene to continue from. */
  state() {
    const { eye, right, up, back, target, lens, size } = this;
    return structuredClone({ eye, right, up, back, target, lens, size });
  }

  restore(state) {
    Object.assign(this, structuredClone(state));
  }

  /** Focal lengths and principal point in pixels of a canvas. */
  lensOn(width, height) {
    const [w, h] = this.size, scale = Math.min(width / w, height / h), [fx, fy, cx, cy] = this.lens;
    return [fx * scale, fy * scale, width / 2 + (cx - w / 2) * scale, height / 2 + (cy - h / 2) * scale];
  }

  /**
   * Turns by angles to the right and down, about the target or, in a room, about the eye. A scene that was seen from one side
   * can be turned only `MARGIN` beyond its cameras.
   */
  orbit(right, down) {
    const before = this.state();
    const pole = Math.acos(Math.max(-1, Math.min(1, dot(this.back, this.world))));
    const pitch = Math.max(0.03, Math.min(Math.PI - 0.03, pole - down)) - pole;
    this.turn(this.world, -right);
    const level = cross(this.world, this.back);
    this.turn(norm(level) > 1e-3 ? unit(level) : this.right, pitch);
    if (this.limit && this.offMiddle(this.back) > Math.max(this.limit, this.offMiddle(before.back))) this.restore(before);
  }

  turn(axis, angle) {
    const pivot = this.scene.inside ? this.eye : this.target;
    for (const name of ['right', 'up', 'back']) this[name] = unit(turned(this[name], axis, angle));
    this.eye = add(pivot, turned(minus(this.eye, pivot), axis, angle));
    this.target = add(pivot, turned(minus(this.target, pivot), axis, angle));
  }

  /** Moves along the image by pixels of a canvas, at the target's distance. */
  pan(x, y, width, height) {
    const distance = norm(minus(this.eye, this.target)), [fx, fy] = this.lensOn(width, height);
    const by = add(times(this.right, (-x * distance) / fx), times(this.up, (y * distance) / fy));
    this.eye = add(this.eye, by);
    this.target = add(this.target, by);
  }

  /** Multiplies the distance to the target by a factor, within limits. */
  zoom(factor) {
    const { radius } = this.scene, from = minus(this.eye, this.target);
    const distance = Math.max(0.02 * radius, Math.min(10 * radius, norm(from) * factor));
    this.eye = add(this.target, times(unit(from), distance));
  }

  /**
   * Distances between which rays are followed. At the distances of the training cameras they are the scene's; closer, the
   * near one shrinks, and farther away the far one grows.
   */
  interval() {
    const { near, far, centre, cameras } = this.scene;
    const from = (eye) => norm(minus(eye, centre));
    const all = cameras.map((camera) => from(camera.pose.slice(12, 15))), here = from(this.eye);
    const [nearest, farthest] = [Math.min(...all), Math.max(...all)];
    return [near * Math.min(1, here / (nearest * (1 - 1e-6) || 1)), far + Math.max(0, here - farthest)];
  }
}
