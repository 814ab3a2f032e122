/** Joint positions as the live stream has them, in rad and m. */
import type { MachineContent } from "../live/groups";
import type { Reading } from "../live/history";
import { measured, mark, type QualityMark } from "../live/quality";
import type { Joint } from "./kinematics";
import { t } from "../../texts";

/** rad or m of one, for the units of position that a machine file is likely to use. */
const SI: Record<string, number> = {
  rad: 1,
  mrad: 1e-3,
  deg: Math.PI / 180,
  m: 1,
  mm: 1e-3,
  cm: 1e-2,
};

export interface Position {
  /** rad or m; null where it is not measured now. */
  q: number | null;
  /** As the channel has it; null without a channel. */
  reading: Reading | null;
  quality: QualityMark;
}

const NONE: QualityMark = { kind: "off", text: t("pose.noChannelMeasures") };

/** Of each joint, from its channel of the quantity `joint_position`. */
export function positions(
  joints: Joint[],
  channels: MachineContent["channels"],
  readings: ReadonlyMap<string, Reading>,
  silence: number,
): Position[] {
  return joints.map((joint) => {
    const channel = channels.find((one) => one.quantity === "joint_position" && one.joint === joint.name);
    const reading = channel === undefined ? null : (readings.get(channel.name) ?? null);
    if (channel === undefined || reading === null) return { q: null, reading, quality: NONE };
    const scale = SI[channel.unit];
    const known = measured(reading, silence) && reading.value !== null && scale !== undefined;
    const quality: QualityMark =
      scale === undefined
        ? { kind: "warning", text: t("pose.pageDoesNotKnow", { unit: channel.unit }) }
        : mark(reading, silence);
    return { q: known ? (reading.value as number) * scale : null, reading, quality };
  });
}

/** Where a joint is between its limits, 0 to 1; outside of them below 0 or above 1. */
export function between(joint: Joint, q: number): number {
  const [low, high] = joint.limits.position;
  return high > low ? (q - low) / (high - low) : 0.5;
}

/** What is drawn for a joint that is not measured: the middle of its limits. */
export function middle(joint: Joint): number {
  const [low, high] = joint.limits.position;
  return Number.isFinite(low + high) ? (low + high) / 2 : 0;
}
