/** Which part of time is shown: the newest `span` seconds, or from one moment to another. */
import { t } from "../texts";

export type Shown = { kind: "live"; span: number } | { kind: "fixed"; from: number; to: number };
export type Range = [number, number];

export const SHORTEST_S = 0.2;

/** Zoomed by `factor` (below 1: closer) around `centre`, within `bounds`. */
export function zoomed([from, to]: Range, factor: number, centre: number, bounds: Range): Range {
  const share = to > from ? Math.min(1, Math.max(0, (centre - from) / (to - from))) : 0.5;
  const span = Math.min(Math.max((to - from) * factor, SHORTEST_S), Math.max(SHORTEST_S, bounds[1] - bounds[0]));
  return within([centre - share * span, centre + (1 - share) * span], bounds);
}

/** Moved by `seconds`, within `bounds`. */
export function panned([from, to]: Range, seconds: number, bounds: Range): Range {
  return within([from + seconds, to + seconds], bounds);
}

/** The range itself where it fits, else moved (and, only if it is longer than that, cut) into `bounds`. */
export function within([from, to]: Range, [low, high]: Range): Range {
  if (to - from >= high - low) return [low, high];
  if (from < low) return [low, low + to - from];
  if (to > high) return [high - (to - from), high];
  return [from, to];
}

/** `10 s`, `2 min`, `8 h`. */
export function spanWords(seconds: number): string {
  if (seconds < 60) return `${seconds} s`;
  return seconds < 3600 ? t("charts.min", { seconds: seconds / 60 }) : `${seconds / 3600} h`;
}

export const SPANS = [10, 30, 120, 600, 3600, 8 * 3600];
/** The furthest back that the service remembers, s. */
export const LONGEST_S = 8 * 3600;
