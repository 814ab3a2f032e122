/** What the service's names mean to a person. */
import type { NoticeKind } from "./ui/controls";

export type Role = "unloaded" | "train" | "repeat" | "validate" | "operation";

export const ROLE_WORDS: Record<Role, string> = {
  operation: "Normal work",
  unloaded: "Rods unpinned",
  train: "Training motion",
  repeat: "Training motion, once more",
  validate: "Validation motion",
};

export const JOB_WORDS: Record<string, [NoticeKind | "off", string]> = {
  queued: ["info", "Waiting for its turn"],
  running: ["info", "Running"],
  done: ["good", "Done"],
  failed: ["bad", "Failed"],
  cancelled: ["off", "Cancelled"],
};

export const MONITOR_WORDS: Record<string, [NoticeKind | "off", string]> = {
  off: ["off", "Monitor off"],
  learning: ["info", "Learning the baseline"],
  watching: ["good", "Monitor watches, no drift"],
  drift: ["bad", "Drift: the arm is not as it was calibrated"],
};

export const ACQUISITION_WORDS: Record<string, [NoticeKind | "off", string]> = {
  off: ["off", "Acquisition is off"],
  starting: ["info", "Acquisition is starting"],
  running: ["good", "Acquisition is running"],
  waiting: ["warning", "Acquisition broke off and is tried again"],
  stopped: ["off", "Acquisition is stopped"],
};

const words = (table: Record<string, [NoticeKind | "off", string]>, state: string): [NoticeKind | "off", string] =>
  table[state] ?? ["warning", state];

export const jobWords = (state: string) => words(JOB_WORDS, state);
export const monitorWords = (state: string) => words(MONITOR_WORDS, state);
export const acquisitionWords = (state: string) => words(ACQUISITION_WORDS, state);
