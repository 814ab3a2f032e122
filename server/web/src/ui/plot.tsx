/** A drawing with axes (uPlot), drawn again when the theme or the size changes; a table says the same in words. */
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { number, ticks } from "./format";
import { colours, theme, transparent } from "./theme";
import { t } from "../texts";

export interface PlotSeries {
  label: string;
  values: (number | null)[];
  band?: [(number | null)[], (number | null)[]];
  kind?: "line" | "points";
}
export interface PlotProps {
  title: string;
  unit: string;
  x: { label: string; values: number[] };
  series: PlotSeries[];
  height?: number;
  /** Ends of the vertical axis, for drawings that are compared; from the values otherwise. */
  range?: [number, number];
}

/** Series by colour and dash, so that colour is never all that tells them apart. */
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3], [5, 5], [1, 4]];

export function Plot({ title, unit, x, series, height = 260, range }: PlotProps) {
  const place = useRef<HTMLDivElement>(null);
  const dark = theme.value;
  const shape = series.map((one) => `${one.label}|${one.kind ?? "line"}|${one.band ? "band" : ""}`).join("\n");
  const plot = useRef<uPlot | null>(null);
  useEffect(() => {
    const element = place.current;
    if (element === null) return;
    const made = new uPlot(
      options(element.clientWidth, height, unit, x.label, series, range),
      data(x.values, series),
      element,
    );
    plot.current = made;
    const observer = new ResizeObserver(() => {
      if (element.clientWidth > 0 && element.clientWidth !== made.width)
        made.setSize({ width: element.clientWidth, height });
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
      plot.current = null;
    };
  }, [shape, unit, x.label, height, dark, range?.[0], range?.[1]]);
  useEffect(() => plot.current?.setData(data(x.values, series)), [x.values, series]);
  return (
    <figure class="plot">
      <figcaption>
        {title} <span class="unit">{unit}</span>
      </figcaption>
      <div ref={place} aria-hidden="true" />
      <PlotInWords x={x} series={series} unit={unit} />
    </figure>
  );
}

/** For who cannot see the drawing: from where to where each series goes, and its ends. */
function PlotInWords({ x, series, unit }: Pick<PlotProps, "x" | "series" | "unit">) {
  const from = x.values[0];
  const to = x.values[x.values.length - 1];
  return (
    <p class="for-reader">
      {t("common.fromTo", { label: x.label, from: number(from), to: number(to) })}{" "}
      {series.map((one) => {
        const known = one.values.filter((value): value is number => value !== null && Number.isFinite(value));
        if (known.length === 0) return t("common.noValues", { label: one.label });
        let low = Infinity;
        let high = -Infinity;
        for (const value of known) {
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
        return t("common.toLast", {
          label: one.label,
          low: number(low),
          high: number(high),
          unit,
          count: number(known[known.length - 1]),
        });
      })}
    </p>
  );
}

function data(x: number[], series: PlotSeries[]): uPlot.AlignedData {
  const columns: (number | null)[][] = [];
  for (const one of series) {
    columns.push(one.values);
    if (one.band) columns.push(one.band[0], one.band[1]);
  }
  return [x, ...columns] as uPlot.AlignedData;
}

function options(
  width: number,
  height: number,
  unit: string,
  xLabel: string,
  series: PlotSeries[],
  range?: [number, number],
): uPlot.Options {
  const colour = colours();
  const lines: uPlot.Series[] = [{ label: xLabel }];
  const bands: uPlot.Band[] = [];
  series.forEach((one, index) => {
    const stroke = colour.series[index % colour.series.length] as string;
    const points = one.kind === "points";
    lines.push({
      label: one.label,
      stroke,
      width: points ? 0 : 2,
      dash: DASHES[index % DASHES.length] ?? [],
      points: { show: points, size: 7, fill: stroke },
      ...(points ? { paths: () => null } : {}),
      value: (_plot, value) => number(value),
    });
    if (one.band) {
      const at = lines.length;
      const edge: uPlot.Series = { class: "edge", stroke: transparent(stroke, 0.5), width: 1, points: { show: false } };
      lines.push(
        { ...edge, label: t("common.lower", { label: one.label }) },
        { ...edge, label: t("common.upper", { label: one.label }) },
      );
      bands.push({ series: [at + 1, at], fill: transparent(stroke, 0.18) });
    }
  });
  const axis: uPlot.Axis = {
    stroke: colour.text,
    grid: { stroke: colour.grid, width: 1 },
    ticks: { stroke: colour.grid, width: 1 },
    font: colour.font,
    labelFont: colour.font,
    values: (_plot, places) => ticks(places),
  };
  return {
    width: Math.max(160, width),
    height,
    scales: { x: { time: false }, ...(range === undefined ? {} : { y: { range } }) },
    series: lines,
    bands,
    axes: [
      { ...axis, label: xLabel, labelSize: 22 },
      { ...axis, label: unit, labelSize: 22, size: 64 },
    ],
    cursor: { drag: { x: false, y: false } },
    legend: { show: series.length > 1 || series.some((one) => one.band !== undefined), live: false },
  };
}
