/** What a channel's quality means, in words; the names are the service's. */
import type { NoticeKind } from "../../ui/controls";
import { duration } from "../../ui/format";
import type { Reading } from "./history";

const WORDS: Record<string, [NoticeKind | "off", string]> = {
  fresh: ["good", "fresh"],
  late: ["warning", "late"],
  stale: ["bad", "stale"],
  missing: ["bad", "missing"],
  out_of_range: ["warning", "out of range"],
  emergency: ["bad", "sensor error"],
  bus_error: ["bad", "bus is down"],
  invalid: ["bad", "no valid number"],
  frozen: ["bad", "frozen"],
  held: ["good", "at its own rate"],
};
/** Seconds of silence after which nothing that is shown passes for measured now. */
export const SILENT_S = 2;

export interface QualityMark {
  kind: NoticeKind | "off";
  text: string;
}

/** Quality of a reading; `silence` is how long (s) this page has heard nothing of the machine. */
export function mark(reading: Reading, silence: number): QualityMark {
  if (silence >= SILENT_S) return { kind: "bad", text: `stale for ${duration(silence + (reading.age ?? 0))}` };
  const [kind, text] = WORDS[reading.quality] ?? ["warning", reading.quality];
  const old = reading.age !== null && reading.age >= 1 && reading.quality !== "fresh";
  return { kind, text: old ? `${text} for ${duration(reading.age)}` : text };
}

/** Whether the value may be read as measured now. */
export function measured(reading: Reading, silence: number): boolean {
  return silence < SILENT_S && ["fresh", "late", "out_of_range"].includes(reading.quality);
}
