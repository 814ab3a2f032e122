/** Where the frames of an arm are, from the table of its machine file (Denavit-Hartenberg, standard or modified). */

export interface Joint {
  name: string;
  type: "revolute" | "prismatic";
  dh: { a: number; alpha: number; d: number; theta: number };
  limits: { position: [number, number] };
}
export interface Arm {
  convention?: "standard" | "modified";
  gravity: [number, number, number];
  joints: Joint[];
}
export type Vector = [number, number, number];
/** Axes x, y, z of a frame and its origin, in the base frame, m. */
export interface Frame {
  x: Vector;
  y: Vector;
  z: Vector;
  origin: Vector;
}

const BASE: Frame = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1], origin: [0, 0, 0] };

/** `a + s b`. */
export const plus = (a: Vector, b: Vector, s = 1): Vector => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export function normal(a: Vector): Vector {
  const length = Math.hypot(...a);
  return length === 0 ? a : [a[0] / length, a[1] / length, a[2] / length];
}

/** Turned by `theta` about its z axis and moved by `d` along it. */
function alongZ(frame: Frame, theta: number, d: number): Frame {
  const [c, s] = [Math.cos(theta), Math.sin(theta)];
  const { x, y, z, origin } = frame;
  const turned: Vector = [c * x[0] + s * y[0], c * x[1] + s * y[1], c * x[2] + s * y[2]];
  return { x: turned, y: cross(z, turned), z, origin: plus(origin, z, d) };
}

/** Turned by `alpha` about its x axis and moved by `a` along it. */
function alongX(frame: Frame, alpha: number, a: number): Frame {
  const [c, s] = [Math.cos(alpha), Math.sin(alpha)];
  const { x, y, z, origin } = frame;
  const turned: Vector = [c * y[0] + s * z[0], c * y[1] + s * z[1], c * y[2] + s * z[2]];
  return { x, y: turned, z: cross(x, turned), origin: plus(origin, x, a) };
}

export interface Pose {
  /** Base, then the frame of each link. */
  frames: Frame[];
  /** Of each link the points that it goes through: along `d` and along `a`. */
  links: Vector[][];
  /** Of each joint a point on its axis, and the axis. */
  joints: { at: Vector; axis: Vector }[];
}

/** The pose at joint positions `q` (rad, m). */
export function pose(arm: Arm, q: number[]): Pose {
  const frames = [BASE];
  const links: Vector[][] = [];
  const joints: Pose["joints"] = [];
  arm.joints.forEach((joint, index) => {
    const before = frames[index] as Frame;
    const { a, alpha, d, theta } = joint.dh;
    const turns = joint.type === "revolute";
    const angle = theta + (turns ? (q[index] ?? 0) : 0);
    const along = d + (turns ? 0 : (q[index] ?? 0));
    const modified = arm.convention === "modified";
    const middle = modified ? alongX(before, alpha, a) : alongZ(before, angle, along);
    const after = modified ? alongZ(middle, angle, along) : alongX(middle, alpha, a);
    joints.push(modified ? { at: middle.origin, axis: middle.z } : { at: before.origin, axis: before.z });
    links.push([before.origin, middle.origin, after.origin]);
    frames.push(after);
  });
  return { frames, links, joints };
}
