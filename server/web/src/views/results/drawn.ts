/** The report's figures as series to draw. */
import type { PlotSeries } from "../../ui/plot";
import type { FrictionCurve, Scatter } from "./report";
import { t } from "../../texts";

export interface Drawn {
  x: number[];
  series: PlotSeries[];
}
export interface Cloud {
  before: Drawn;
  after: Drawn;
  /** Ends of the vertical axis that both share: what shrank has to look smaller. */
  range: [number, number];
  /** Standard deviations of the two clouds. */
  spread: { before: number; after: number };
}

type Values = (number | null)[];

/**
 * Residual against the blamed variable. Points of either direction are drawn apart where the law is another one each way,
 * because an odd law averages out otherwise; the law stands in the drawing before, where it is to be seen.
 */
export function cloud(scatter: Scatter): Cloud {
  const order = scatter.x
    .map((x, index) => ({ x, index }))
    .filter((one): one is { x: number; index: number } => one.x !== null)
    .sort((a, b) => a.x - b.x)
    .map((one) => one.index);
  const x = order.map((index) => scatter.x[index] as number);
  const pick = (values: Values): Values => order.map((index) => values[index] ?? null);
  const ways = scatter.direction === null ? null : order.map((index) => scatter.direction?.[index] ?? 0);
  const points = (values: Values): PlotSeries[] => {
    const picked = pick(values);
    if (ways === null) return [{ label: t("results.samples"), values: picked, kind: "points" }];
    const only = (sign: number): Values => picked.map((value, at) => (ways[at] === sign ? value : null));
    return [
      { label: t("results.speed0"), values: only(1), kind: "points" },
      { label: t("results.speed02"), values: only(-1), kind: "points" },
    ];
  };
  const found = laws(scatter, x);
  // What the law explains lies on it; what was left before lies beside it where other parameters had taken its place.
  const first = scatter.partial ?? scatter.before;
  const drawn = found.flatMap((law) => [...law.values, ...(law.band ?? []).flat()]);
  const known = [...first, ...scatter.after, ...drawn].filter((value): value is number => value !== null);
  const low = Math.min(0, ...known);
  const high = Math.max(0, ...known);
  const margin = 0.05 * (high - low || 1);
  return {
    before: { x, series: [...points(first), ...found] },
    after: { x, series: points(scatter.after) },
    range: [low - margin, high + margin],
    spread: { before: deviation(first), after: deviation(scatter.after) },
  };
}

function laws(scatter: Scatter, x: number[]): PlotSeries[] {
  if (scatter.law_x.length < 2) return [];
  const at = (values: Values): Values => interpolated(scatter.law_x, values, x);
  const std = at(scatter.law_std);
  const both = (values: Values, sign: number): Values =>
    values.map((value, index) => {
      const deviation = std[index] ?? null;
      return value === null || deviation === null ? null : value + 2 * sign * deviation;
    });
  const there = at(scatter.law_y);
  const band: [Values, Values] = [both(there, -1), both(there, 1)];
  if (scatter.law_back === null) return [{ label: t("results.lawFound2Std"), values: there, band }];
  return [
    { label: t("results.lawAtSpeed0"), values: there, band },
    { label: t("results.lawAtSpeed02"), values: at(scatter.law_back) },
  ];
}

/** Values at rising places between known ones, by straight lines; null outside of them and beside what is unknown. */
export function interpolated(places: Values, values: Values, wanted: number[]): Values {
  let at = 0;
  return wanted.map((x) => {
    while (at < places.length - 2 && (places[at + 1] ?? Infinity) < x) at += 1;
    const [x0, x1, y0, y1] = [places[at], places[at + 1], values[at], values[at + 1]];
    if (x0 == null || x1 == null || y0 == null || y1 == null || x < x0 || x > x1) return null;
    return x1 === x0 ? y0 : y0 + ((y1 - y0) * (x - x0)) / (x1 - x0);
  });
}

/** Friction over speed of one joint; the band is two standard deviations. */
export function friction(curve: FrictionCurve): Drawn {
  const edge = (sign: number): Values =>
    curve.force.map((force, index) => {
      const std = curve.std[index] ?? null;
      return force === null || std === null ? null : force + 2 * sign * std;
    });
  const first: PlotSeries = {
    label: curve.after === null ? t("results.friction2Std") : t("results.before2Std"),
    values: curve.force,
    band: [edge(-1), edge(1)],
  };
  const series = curve.after === null ? [first] : [first, { label: t("results.afterShort"), values: curve.after }];
  return { x: curve.speed.map((speed) => speed ?? Number.NaN), series };
}

function deviation(values: Values): number {
  const known = values.filter((value): value is number => value !== null);
  if (known.length === 0) return Number.NaN;
  const mean = known.reduce((sum, value) => sum + value, 0) / known.length;
  return Math.sqrt(known.reduce((sum, value) => sum + (value - mean) ** 2, 0) / known.length);
}
