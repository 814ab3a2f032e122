/** Recordings that are chosen for an identification, each in a role; and what the choice lacks. */
import type { components } from "../../net/api.gen";
import type { Role } from "../../words";
import { t } from "../../texts";

type Recording = components["schemas"]["RecordingResource"];

/** Role by recording; what is not chosen is not in it. */
export type Selection = Record<string, Role>;

export function toggled(selection: Selection, recording: Pick<Recording, "id" | "role">): Selection {
  const { [recording.id]: chosen, ...others } = selection;
  return chosen === undefined ? { ...others, [recording.id]: recording.role as Role } : others;
}

export interface Advice {
  /** Why it cannot be ordered; null if it can. */
  wrong: string | null;
  /** What the result will lack. */
  weak: string[];
}

/** What a choice of roles lets an identification say, before it is ordered. */
export function advice(roles: Role[]): Advice {
  const has = (role: Role): boolean => roles.includes(role);
  if (roles.length === 0) return { wrong: t("recordings.chooseRecordingsList"), weak: [] };
  if (!has("train") && !has("operation")) return { wrong: t("recordings.oneRecordingTrainingMotion"), weak: [] };
  if (!has("validate") && !has("operation"))
    return {
      wrong: t("recordings.oneRecordingValidationMotion"),
      weak: [],
    };
  const weak: string[] = [];
  if (!has("repeat")) weak.push(t("recordings.withoutTrainingMotionOnce"));
  if (!has("unloaded")) weak.push(t("recordings.withoutRecordingWithRods"));
  return { wrong: null, weak };
}
