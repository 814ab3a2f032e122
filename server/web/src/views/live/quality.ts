/** What a channel's quality means, in words; the names are the service's. */
import type { NoticeKind } from "../../ui/controls";
import { duration } from "../../ui/format";
import type { Reading } from "./history";
import { t } from "../../texts";

const WORDS: Record<string, [NoticeKind | "off", string]> = {
  fresh: ["good", t("live.fresh")],
  late: ["warning", t("live.late")],
  stale: ["bad", t("live.stale")],
  missing: ["bad", t("live.missing")],
  out_of_range: ["warning", t("live.outOfRange")],
  emergency: ["bad", t("live.sensorError")],
  bus_error: ["bad", t("live.busIsDown")],
  invalid: ["bad", t("live.noValidNumber")],
  frozen: ["bad", t("live.frozen")],
  held: ["good", t("live.atItsOwnRate")],
};
/** Seconds of silence after which nothing that is shown passes for measured now. */
export const SILENT_S = 2;

export interface QualityMark {
  kind: NoticeKind | "off";
  text: string;
}

/** Quality of a reading; `silence` is how long (s) this page has heard nothing of the machine. */
export function mark(reading: Reading, silence: number): QualityMark {
  if (silence >= SILENT_S)
    return { kind: "bad", text: t("live.staleFor2", { silence: duration(silence + (reading.age ?? 0)) }) };
  const [kind, text] = WORDS[reading.quality] ?? ["warning", reading.quality];
  const old = reading.age !== null && reading.age >= 1 && reading.quality !== "fresh";
  return { kind, text: old ? t("live.for", { text, age: duration(reading.age) }) : text };
}

/** Whether the value may be read as measured now. */
export function measured(reading: Reading, silence: number): boolean {
  return silence < SILENT_S && ["fresh", "late", "out_of_range"].includes(reading.quality);
}
