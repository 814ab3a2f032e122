/** How an arm is looked at: parallel, gravity downwards, turned about the vertical and tilted. */
import { type Arm, cross, dot, normal, plus, pose, type Vector } from "./kinematics";

/** Two axes of the drawing and the direction towards who looks, in the base frame; unit vectors. */
export interface View {
  right: Vector;
  up: Vector;
  towards: Vector;
}

/** Upwards: against gravity; along z where the file says none. */
export function upwards(arm: Arm): Vector {
  const size = Math.hypot(...arm.gravity);
  return size === 0 ? [0, 0, 1] : normal([-arm.gravity[0], -arm.gravity[1], -arm.gravity[2]]);
}

/**
 * Looking at the arm from `azimuth` (rad, about the vertical; 0: along the axis of its first horizontal joint, which
 * shows the plane in which it moves) and from `elevation` above the horizon (rad, π/2: from above).
 */
export function view(arm: Arm, azimuth: number, elevation: number): View {
  const up = upwards(arm);
  const front = facing(arm, up);
  const side = cross(up, front);
  const level = plus(scaled(front, Math.cos(azimuth)), side, Math.sin(azimuth));
  const towards = plus(scaled(level, Math.cos(elevation)), up, Math.sin(elevation));
  const right = cross(up, level);
  return { right, up: cross(towards, right), towards };
}

const scaled = (a: Vector, s: number): Vector => [s * a[0], s * a[1], s * a[2]];

/** A horizontal direction to look from: the first joint's axis that is nearly horizontal. */
function facing(arm: Arm, up: Vector): Vector {
  const zero = arm.joints.map(() => 0);
  const axes = pose(arm, zero).joints.map((joint) => joint.axis);
  const found = axes.find((axis) => Math.abs(dot(axis, up)) < 0.5);
  const other: Vector = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const direction = found ?? other;
  return normal(plus(direction, up, -dot(direction, up)));
}

/** Where a point is in the drawing, m: to the right and upwards. */
export const projected = (point: Vector, { right, up }: View): [number, number] => [dot(point, right), dot(point, up)];

/** How far the arm can be from its base at most, m: half the height of a drawing in which it never leaves. */
export function reach(arm: Arm): number {
  const sum = arm.joints.reduce((all, joint) => {
    const moves = joint.type === "prismatic" ? Math.max(...joint.limits.position.map(Math.abs)) : 0;
    return all + Math.hypot(joint.dh.a, Math.abs(joint.dh.d) + moves);
  }, 0);
  return sum > 0 ? sum : 1;
}
