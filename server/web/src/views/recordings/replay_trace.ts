/** Signals of recordings as lines to draw: one recording, or two whose first rows stand at the same time. */
import uPlot from "uplot";
import type { Range } from "../../charts/range";
import type { Trace, Value } from "../../charts/trace";
import { column, type Group } from "../live/groups";

/** Times and columns of one group: the lines of the first recording, then those of the second. */
export function joined(group: Group, first: Trace, second: Trace | null): { t: number[]; columns: Value[][] } {
  const own = group.lines.map((line) => column(line, first));
  if (second === null) return { t: first.t, columns: own };
  const other = group.lines.map((line) => column(line, second));
  const [t, ...columns] = uPlot.join([
    [first.t, ...own],
    [second.t, ...other],
  ] as uPlot.AlignedData[]) as unknown as [number[], ...Value[][]];
  return { t, columns };
}

/** The range of a replay after `seconds` more of the recording; it stops at the end. */
export function played([from, to]: Range, seconds: number, end: number): Range {
  const step = Math.max(0, Math.min(seconds, end - to));
  return [from + step, to + step];
}
