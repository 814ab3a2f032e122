/** What a time line draws: events as marks and bars in lanes. */
import type { components } from "../../net/api.gen";
import type { NoticeKind } from "../../ui/controls";
import { dayMonth, monthYear, number } from "../../ui/format";
import { verdictWords, words } from "../results/wording";
import { t } from "../../texts";
import { said } from "../../texts/report";

export type HistoryEvent = components["schemas"]["HistoryEvent"];
export type Kind = HistoryEvent["kind"];

export const KINDS: Kind[] = ["calibration", "identification", "drift", "alarm", "file"];
export const LANES: Record<Kind, string> = {
  calibration: t("history.calibrationInUse"),
  identification: t("history.effectsFound"),
  drift: t("history.drifts"),
  alarm: t("common.alarms"),
  file: t("common.machineFile"),
};

const STEPS: Record<string, string> = {
  proposed: t("common.wasProposed"),
  approved: t("common.wasApproved"),
  rejected: t("common.wasRejected"),
  activated: t("common.cameIntoUse"),
  retired: t("common.wasNoLongerUse"),
};
const ALARMS: Record<string, string> = {
  acquisition_down: t("history.acquisitionWasDown"),
  channel_stale: t("history.channelDidNotMeasure"),
  disk_full: t("history.diskWasNearlyFull"),
  clock_jumped: t("history.theClockJumped"),
  residual_drift: t("history.measuredPredictedEffortDrifted"),
  valve_drift: t("history.valvesDrifted"),
  residual_grew: t("history.errorGrewSinceCalibration"),
  overload: t("history.overload"),
  recalibration_failed: t("history.aRecalibrationFailed"),
  worker_silent: t("history.workerFellSilent"),
  store_damaged: t("history.storeWasDamaged"),
  audit_cut: t("history.auditLogWasCut"),
  backup_failed: t("history.backupFailed"),
  webhook_failed: t("history.webhookFailed"),
};

export interface Drawn {
  /** ms since 1970. */
  from: number;
  /** Where it lasted; null: a moment. */
  to: number | null;
  tone: NoticeKind | "off";
  text: string;
  /** A word beside the mark, where there is room. */
  label: string;
}

const at = (iso: string): number => new Date(iso).getTime();

/** Effects as one text: `friction that depends on the piston position at joint2`. */
export function effectsOf(event: HistoryEvent): string {
  return (event.effects ?? [])
    .map(({ title, joint }) => (joint === null ? said(title) : t("history.at", { title: said(title), joint })))
    .join(", ");
}

/** What happened, in a sentence. */
export function sentence(event: HistoryEvent): string {
  const error = event.error == null ? "" : t("history.errorTimesNoise", { error: number(event.error, 3) });
  const by = event.by == null ? "" : t("history.by", { by: event.by });
  const effects = effectsOf(event);
  switch (event.kind) {
    case "file":
      return t("history.versionMachineFileWas", { subject: event.subject });
    case "identification":
      return `${verdictWords(event.what)[1]}${effects === "" ? "" : `: ${effects}`}${error}`;
    case "calibration":
      return t("history.calibration", {
        text: event.text,
        what: STEPS[event.what] ?? words(event.what),
        by,
        effects: effects === "" ? "" : t("history.with", { effects }),
      });
    default: {
      const seen = event.by == null ? "" : t("history.seenBy", { by: event.by });
      return `${ALARMS[event.what] ?? words(event.what)}: ${said(event.text, event.text_message)}${seen}`;
    }
  }
}

export function tone(event: HistoryEvent): NoticeKind | "off" {
  if (event.severity != null) return event.severity === "critical" ? "bad" : event.severity;
  if (event.kind === "identification") return verdictWords(event.what)[0];
  if (event.kind === "calibration")
    return event.what === "activated"
      ? "good"
      : event.what === "rejected"
        ? "bad"
        : event.what === "retired"
          ? "off"
          : "info";
  return "info";
}

export function href(event: HistoryEvent, machine: string): string {
  switch (event.kind) {
    case "file":
      return `#/machines/${encodeURIComponent(machine)}`;
    case "identification":
      return `#/results/${event.subject}`;
    case "calibration":
      return "#/calibrations";
    default:
      return "#/alarms";
  }
}

/** The lane of a kind, oldest first. A calibration is a bar for as long as it was in use, an alarm while it held. */
export function lane(kind: Kind, events: HistoryEvent[], now: number): Drawn[] {
  const mine = events.filter((event) => event.kind === kind).reverse();
  if (kind === "calibration") return inUse(mine, now);
  return mine.map((event) => {
    const lasts = kind === "drift" || kind === "alarm";
    const label =
      kind === "identification"
        ? (event.effects ?? []).map((one) => said(one.title)).join(", ") || verdictWords(event.what)[1]
        : kind === "file"
          ? t("history.version", { subject: event.subject })
          : (ALARMS[event.what] ?? words(event.what));
    return {
      from: at(event.time),
      to: lasts ? (event.until == null ? now : Math.max(at(event.time), at(event.until))) : null,
      tone: tone(event),
      text: sentence(event),
      label,
    };
  });
}

/** Bars of use, and marks of the other steps. The steps are oldest first. */
function inUse(steps: HistoryEvent[], now: number): Drawn[] {
  const found: Drawn[] = [];
  const open = new Map<string, Drawn>();
  for (const step of steps) {
    const drawn: Drawn = {
      from: at(step.time),
      to: null,
      tone: tone(step),
      text: sentence(step),
      label: "",
    };
    if (step.what === "activated") {
      const bar = { ...drawn, to: now, label: step.text };
      open.set(step.subject, bar);
      found.push(bar);
    } else if (step.what === "retired") {
      const bar = open.get(step.subject);
      if (bar !== undefined) bar.to = at(step.time);
      open.delete(step.subject);
    } else if (step.what !== "approved") found.push(drawn);
  }
  return found;
}

/** Errors that identifications reached, oldest first: ms since 1970, times the noise. */
export function errors(events: HistoryEvent[]): [number, number][] {
  return events
    .filter((event) => event.kind === "identification" && event.error != null)
    .map((event): [number, number] => [at(event.time), event.error as number])
    .reverse();
}

/** Ends of days, months or years between two moments, in the zone of this device; at most about `most`. */
export function dates(from: number, to: number, most: number): { at: number; text: string }[] {
  const day = 86_400_000;
  const days = (to - from) / day;
  const step = [1, 2, 7, 14].find((one) => days / one <= most);
  const found: { at: number; text: string }[] = [];
  const first = new Date(from);
  if (step !== undefined) {
    for (let day = 1; ; day += step) {
      const date = new Date(first.getFullYear(), first.getMonth(), first.getDate() + day);
      if (date.getTime() > to) return found;
      found.push({ at: date.getTime(), text: dayMonth(date) });
    }
  }
  const months = [1, 2, 3, 6, 12, 24].find((one) => days / 30.4 / one <= most) ?? 60;
  for (let month = months - (first.getMonth() % months); ; month += months) {
    const date = new Date(first.getFullYear(), first.getMonth() + month, 1);
    if (date.getTime() > to) return found;
    found.push({ at: date.getTime(), text: monthYear(date) });
  }
}
