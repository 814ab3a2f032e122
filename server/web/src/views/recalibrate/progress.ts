/**
 * How far a guided recalibration is.
 *
 * The device keeps only what no service can know: which guide this is, and what a person confirmed at the machine.
 * Which recordings and which identification belong to it is read from the service: they carry the guide's label.
 */
import type { components } from "../../net/api.gen";
import { remember, remembered } from "../../storage";
import type { Role } from "../../words";

type Recording = components["schemas"]["RecordingResource"];

export interface Guide {
  /** Begins the label of all that is made on the way, and is unlike any other guide's. */
  label: string;
  /** Name of the one order (Idempotency-Key): however often it is sent, one identification is made. */
  key: string;
  checked: boolean;
  unpinned: boolean;
  /** Stage 1 in place: the rods stay on, nothing is recorded without the arm. */
  stayOn: boolean;
  pinned: boolean;
  /** Counts the orders: one that failed is followed by another with other recordings. */
  attempt: number;
  /** Recordings that somebody wants to make again. */
  dropped: string[];
  /** Motion (excitation) that was chosen for each role, if the service designed it. */
  motions: Partial<Record<Role, string>>;
  /** Motions that an identification asked for, to tell apart what it could not; each is recorded once. */
  closings: Closing[];
}

export interface Closing {
  /** Whose next experiment it is. */
  identification: string;
  rods: "pinned" | "unpinned";
  /** What the motion is, in words. */
  text: string;
}

/** Recordings that a design counts on at most. */
export const MOST_CLOSINGS = 4;

export type Step = "check" | "unpin" | "unloaded" | "pin" | "train" | "repeat" | "validate" | "closing" | "identify";
export const STEPS: Step[] = [
  "check",
  "unpin",
  "unloaded",
  "pin",
  "train",
  "repeat",
  "validate",
  "closing",
  "identify",
];
export const RECORDED: Role[] = ["unloaded", "train", "repeat", "validate"];

const place = (machine: string): string => `hilfit.guide.${machine}`;

export function storedGuide(machine: string): Guide | null {
  const text = remembered(place(machine));
  if (text === null) return null;
  try {
    const value = JSON.parse(text) as Partial<Guide>;
    if (typeof value.label !== "string" || typeof value.key !== "string") return null;
    return { ...newGuide(value.label, value.key), ...value };
  } catch {
    return null;
  }
}

export function storeGuide(machine: string, guide: Guide | null): void {
  remember(place(machine), guide === null ? null : JSON.stringify(guide));
}

export function newGuide(label: string, key: string): Guide {
  return {
    label,
    key,
    checked: false,
    unpinned: false,
    stayOn: false,
    pinned: false,
    attempt: 1,
    dropped: [],
    motions: {},
    closings: [],
  };
}

/** What the identification of a guide is called. */
export function orderLabel(guide: Guide): string {
  // Names of recordings and orders are looked up again, on devices of every language.
  // eslint-disable-next-line code/no-literal-string
  return guide.attempt === 1 ? guide.label : `${guide.label}, attempt ${guide.attempt}`;
}

/** What a guide's recording in a role is called. */
export function recordingLabel(guide: Guide, role: Role): string {
  return `${guide.label}, ${role}`;
}

/** The newest recording of each role that was made in this guide and did not fail; the list is newest first. */
export function recordingsOf(guide: Guide, recordings: Recording[]): Partial<Record<Role, Recording>> {
  const found: Partial<Record<Role, Recording>> = {};
  for (const role of RECORDED) {
    const label = recordingLabel(guide, role);
    const mine = recordings.find(
      (one) => one.role === role && one.label === label && one.state !== "failed" && !guide.dropped.includes(one.id),
    );
    if (mine !== undefined) found[role] = mine;
  }
  return found;
}

/** In what role a motion that closes an ambiguity is fitted. */
export function closingRole(closing: Closing): Role {
  return closing.rods === "unpinned" ? "unloaded" : "train";
}

/** What the recording of a motion that closes an ambiguity is called; the first is 0. */
export function closingLabel(guide: Guide, number: number): string {
  // eslint-disable-next-line code/no-literal-string
  return `${guide.label}, to tell apart ${number + 1}`;
}

/** The recording of each motion that closes an ambiguity, in their order; undefined where there is none yet. */
export function closingsOf(guide: Guide, recordings: Recording[]): (Recording | undefined)[] {
  return guide.closings.map((_, number) => {
    const label = closingLabel(guide, number);
    return recordings.find((one) => one.label === label && one.state !== "failed" && !guide.dropped.includes(one.id));
  });
}

/** The first step that is not done. */
export function currentStep(
  guide: Guide,
  recordings: Partial<Record<Role, Recording>>,
  closings: (Recording | undefined)[] = [],
): Step {
  const sealed = (role: Role): boolean => recordings[role]?.state === "sealed";
  if (!guide.checked) return "check";
  if (!guide.stayOn) {
    if (!guide.unpinned && recordings.unloaded === undefined) return "unpin";
    if (!sealed("unloaded")) return "unloaded";
    if (!guide.pinned) return "pin";
  }
  for (const role of ["train", "repeat", "validate"] as const) if (!sealed(role)) return role;
  return closings.every((one) => one?.state === "sealed") ? "identify" : "closing";
}
