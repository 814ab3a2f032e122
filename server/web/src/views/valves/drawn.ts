/** A valve's report as series to draw, and what it says of the controller's dead band. */
import type { PlotSeries } from "../../ui/plot";
import { interpolated } from "../results/drawn";
import { type Axis, type Direction, WAYS } from "./report";
import { t } from "../../texts";

const NORMAL_95 = 1.959964;

/** Speed over the command with its 95 % band, and a point at each edge. */
export function curve(axis: Axis): { x: number[]; series: PlotSeries[] } {
  const { command, speed, std } = axis.figures.curve;
  const edges = WAYS.flatMap((way) => {
    const found = axis.directions[way].edge_at_2_percent;
    return found === undefined ? [] : [way === "extend" ? found.value : -found.value];
  });
  const x = [...new Set([...command, ...edges])].sort((a, b) => a - b);
  const values = interpolated(command, speed, x);
  const half = std === undefined ? null : interpolated(command, std, x);
  const bound = (sign: number) =>
    values.map((value, at) => (value === null || half?.[at] == null ? null : value + sign * NORMAL_95 * half[at]));
  return {
    x,
    series: [
      {
        label: half === null ? t("valves.speed") : t("valves.speedWithBand"),
        values,
        ...(half === null ? {} : { band: [bound(-1), bound(1)] as [(number | null)[], (number | null)[]] }),
      },
      {
        label: t("valves.edge"),
        values: x.map((place, at) => (edges.includes(place) ? (values[at] ?? null) : null)),
        kind: "points",
      },
    ],
  };
}

/** What the dead band that the controller compensates is worth: null where it compensates none, or nobody can tell. */
export function compensation(direction: Direction): "right" | "small" | "large" | null {
  const found = direction.compensated;
  if (!found) return null;
  const ends = found.too_small_by.ci95;
  if (ends !== null && ends[0] <= 0 && ends[1] >= 0) return "right";
  return found.too_small_by.value > 0 ? "small" : "large";
}
