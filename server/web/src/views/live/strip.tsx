/** A strip of the last half minute with the numbers beside it; the numbers name the lines. */
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { Mark } from "../../ui/controls";
import { fixed } from "../../ui/format";
import { colours, theme } from "../../ui/theme";
import { type Group, column, reading } from "./groups";
import { type History, SPAN_S } from "./history";
import { mark, measured } from "./quality";

const DASHES = [[], [9, 4], [2, 3], [12, 3, 2, 3], [5, 5], [1, 5]];
const HEIGHT = 150;
const AGO = ["−30 s", "−20 s", "−10 s", "now"];

export function Strip({
  group,
  history,
  silence,
  tick,
}: {
  group: Group;
  history: History;
  silence: number;
  tick: number;
}) {
  const place = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const dark = theme.value;
  useEffect(() => {
    const element = place.current;
    if (element === null) return undefined;
    const made = new uPlot(options(element.clientWidth, group), [[]], element);
    plot.current = made;
    const observer = new ResizeObserver(() => {
      if (element.clientWidth > 0) made.setSize({ width: element.clientWidth, height: HEIGHT });
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [group, dark]);
  useEffect(() => {
    const { t, columns } = history;
    const end = t[t.length - 1];
    if (plot.current === null || end === undefined) return;
    plot.current.setData(
      [t, ...group.lines.map((line) => column(line, columns, t.length))] as uPlot.AlignedData,
      false,
    );
    plot.current.setScale("x", { min: end - SPAN_S, max: end });
  }, [tick, group, dark]);
  const old = silence >= 2;
  return (
    <section class={old ? "strip stale" : "strip"} aria-label={group.title}>
      <h3>
        {group.title} <span class="unit">{group.unit}</span>
      </h3>
      <div ref={place} class="strip-plot" aria-hidden="true" />
      <ul class="numbers">
        {group.lines.map((line, index) => {
          const now = reading(line, history.readings);
          const quality = mark(now, silence);
          const good = measured(now, silence);
          return (
            <li key={line.name} class={good ? "number" : "number not-measured"}>
              <span class="name">
                <svg class={`sample series-${(index % 6) + 1}`} viewBox="0 0 28 8" aria-hidden="true">
                  <line x1="0" y1="4" x2="28" y2="4" stroke-dasharray={(DASHES[index % 6] as number[]).join(" ")} />
                </svg>
                {line.label}
              </span>
              <span class="value">
                {fixed(now.value, line.decimals)} <span class="unit">{line.unit}</span>
              </span>
              <Mark kind={quality.kind}>{quality.text}</Mark>
            </li>
          );
        })}
      </ul>
    </section>
  );
}

function options(width: number, group: Group): uPlot.Options {
  const colour = colours();
  const decimals = Math.min(...group.lines.map((line) => line.decimals));
  const axis: uPlot.Axis = {
    stroke: colour.text,
    grid: { stroke: colour.grid, width: 1 },
    ticks: { stroke: colour.grid, width: 1 },
    font: colour.font,
  };
  return {
    width: Math.max(160, width),
    height: HEIGHT,
    scales: {
      x: { time: false, auto: false },
      y: { range: (_plot, low, high) => atLeast(low, high, 20 * 10 ** -decimals) },
    },
    legend: { show: false },
    cursor: { show: false },
    axes: [
      {
        ...axis,
        size: 26,
        splits: (_plot, _axis, _min, max) => [30, 20, 10, 0].map((back) => max - back),
        values: () => AGO,
      },
      { ...axis, size: 62, values: (_plot, splits) => splits.map((value) => fixed(value, decimals)) },
    ],
    series: [
      {},
      ...group.lines.map((line, index) => ({
        label: line.label,
        stroke: colour.series[index % colour.series.length] as string,
        width: 2,
        dash: DASHES[index % DASHES.length] as number[],
        points: { show: false },
      })),
    ],
  };
}

/** A range that noise alone does not fill: at least so much from its lower to its upper end. */
function atLeast(low: number | null, high: number | null, span: number): [number, number] {
  if (low === null || high === null) return [0, span];
  const margin = Math.max(0.08 * (high - low), (span - (high - low)) / 2);
  return [low - margin, high + margin];
}
