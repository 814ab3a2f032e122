/** What a recording's statistics say about it, in words. */
import type { components } from "../../net/api.gen";
import type { NoticeKind } from "../../ui/controls";
import { count } from "../../ui/format";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Recording = components["schemas"]["RecordingResource"];

export interface Quality {
  kind: NoticeKind | "off";
  text: string;
}

const known = (value: unknown): number | null => (typeof value === "number" && Number.isFinite(value) ? value : null);

/** Seconds of machine time; null where it is not known. */
export function seconds(recording: Recording): number | null {
  const { statistics } = recording;
  const given = known(statistics.seconds);
  if (given !== null) return given;
  const rows = known(statistics.rows);
  const rate = known(statistics.rate_hz);
  if (rows !== null && rate !== null && rate > 0) return rows / rate;
  if (recording.ended === null) return null;
  return (new Date(recording.ended).getTime() - new Date(recording.created).getTime()) / 1000;
}

/** Whether it is good to identify from, and what is wrong with it. */
export function quality(recording: Recording): Quality {
  if (recording.state === "recording") return { kind: "info", text: t("recordings.beingRecorded") };
  if (recording.state === "failed") {
    const { error, error_message } = recording;
    return { kind: "bad", text: error === null ? t("common.failed") : said(error, error_message) };
  }
  const { statistics } = recording;
  const faults: string[] = [];
  const missing = known(statistics.missing_rows) ?? 0;
  const rows = known(statistics.rows);
  if (missing > 0) faults.push(t("recordings.rowsWithoutAllValues", { missing: count(missing) }));
  const parts = known(statistics.segments);
  const gaps = known(statistics.gaps) ?? (parts === null ? 0 : Math.max(0, parts - 1));
  const missed = known(statistics.missed_cycles) ?? 0;
  if (missed > 0) faults.push(t("recordings.momentsMissed", { missed: count(missed) }));
  if (gaps > 0) faults.push(t("recordings.gaps", { gaps }));
  const doubtful = channelsNotFresh(statistics.quality);
  if (doubtful > 0) faults.push(t("recordings.withValuesNotFresh", { count: doubtful }));
  if (rows === 0) return { kind: "bad", text: t("recordings.empty") };
  if (faults.length === 0) return { kind: "good", text: t("recordings.noGaps2") };
  const share = rows === null ? 0 : (missing + missed) / rows;
  return { kind: share > 0.05 ? "bad" : "warning", text: faults.join(", ") };
}

/** Channels of a recording that was made here of which some rows are not fresh. */
function channelsNotFresh(given: unknown): number {
  if (typeof given !== "object" || given === null) return 0;
  return Object.values(given as Record<string, unknown>).filter(
    (counts) => typeof counts === "object" && counts !== null && Object.values(counts).some((rows) => Number(rows) > 0),
  ).length;
}
