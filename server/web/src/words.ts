/** What the service's names mean to a person. */
import type { NoticeKind } from "./ui/controls";
import { t } from "./texts";

/** What a role of access is called; the names are the service's. */
export function accessWords(role: "viewer" | "operator" | "engineer" | "admin"): string {
  return t(`common.role.${role}`);
}

export type Role = "unloaded" | "train" | "repeat" | "validate" | "operation";

export const ROLE_WORDS: Record<Role, string> = {
  operation: t("common.normalWork"),
  unloaded: t("common.rodsUnpinned"),
  train: t("common.trainingMotion"),
  repeat: t("common.trainingMotionOnceMore"),
  validate: t("common.validationMotion"),
};

export const JOB_WORDS: Record<string, [NoticeKind | "off", string]> = {
  queued: ["info", t("common.waitingItsTurn")],
  running: ["info", t("common.running")],
  done: ["good", t("common.done")],
  failed: ["bad", t("common.failed")],
  cancelled: ["off", t("common.cancelled")],
};

export const MONITOR_WORDS: Record<string, [NoticeKind | "off", string]> = {
  off: ["off", t("common.monitorOff")],
  learning: ["info", t("common.learningTheBaseline")],
  watching: ["good", t("common.monitorWatchesNoDrift")],
  drift: ["bad", t("common.driftArmNotAs")],
};

export const ACQUISITION_WORDS: Record<string, [NoticeKind | "off", string]> = {
  off: ["off", t("common.acquisitionIsOff")],
  starting: ["info", t("common.acquisitionIsStarting")],
  running: ["good", t("common.acquisitionIsRunning")],
  waiting: ["warning", t("common.acquisitionBrokeOffTried")],
  stopped: ["off", t("common.acquisitionIsStopped")],
};

const words = (table: Record<string, [NoticeKind | "off", string]>, state: string): [NoticeKind | "off", string] =>
  table[state] ?? ["warning", state];

export const jobWords = (state: string) => words(JOB_WORDS, state);
export const monitorWords = (state: string) => words(MONITOR_WORDS, state);
export const acquisitionWords = (state: string) => words(ACQUISITION_WORDS, state);
