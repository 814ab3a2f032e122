/** One drawing over time (uPlot); its owner says when it is drawn, and of what. */
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { fixed, spelt } from "../ui/format";
import { whileSeen } from "../ui/seen";
import { colours, theme } from "../ui/theme";
import { gestures, type Hands } from "./gestures";
import { lines } from "./lines";
import { overlays, type Overlays } from "./overlays";
import type { Range } from "./range";
import type { Value } from "./trace";

/** Series by colour and dash, so that colour is never all that tells them apart. */
export const DASHES = [[], [9, 4], [2, 3], [12, 3, 2, 3], [5, 5], [1, 5]];

export interface Series {
  name: string;
  label: string;
  decimals: number;
  /** One of another recording, in the colour of its namesake. */
  thin?: boolean;
}
export interface Drawn {
  t: number[];
  columns: Value[][];
  range: Range;
}
export interface TimeChartProps {
  title: string;
  series: Series[];
  height: number;
  /** Labels of the times at `places`, of which `span` seconds are shown. */
  timeLabels: (places: number[], span: number) => string[];
  /** Zone of the times, drawn at the left end of the axis; none where times are seconds since something. */
  zone?: string;
  /** What is to be drawn now. */
  read: () => Drawn | null;
  overlays: () => Overlays;
  hands: Hands;
  /** Which entry the cursor is at; null when it left. */
  onCursor: (index: number | null) => void;
  /** Is given what draws; called with null when it goes. */
  register: (draw: (() => void) | null) => void;
}

export function TimeChart(props: TimeChartProps) {
  const place = useRef<HTMLDivElement>(null);
  const now = useRef(props);
  now.current = props;
  const dark = theme.value;
  const { series, height } = props;
  const shape = series.map((one) => one.name).join("\n");
  useEffect(() => {
    const element = place.current;
    if (element === null) return undefined;
    const plot = new uPlot(options(element.clientWidth, now), [[]], element);
    const draw = (): void => {
      const found = now.current.read();
      if (found === null) return;
      const [min, max] = found.range;
      plot.batch(() => {
        plot.setData([found.t, ...found.columns] as uPlot.AlignedData, false);
        plot.setScale("x", { min, max });
      });
    };
    draw();
    const forget = whileSeen(element, (seen) => {
      now.current.register(seen ? draw : null);
      element.classList.toggle("unseen", !seen);
      if (seen) draw(); // as it is now, not as it was when it went out of sight
    });
    const observer = new ResizeObserver(() => {
      if (element.clientWidth > 0 && element.clientWidth !== plot.width)
        plot.setSize({ width: element.clientWidth, height });
    });
    observer.observe(element);
    return () => {
      forget();
      now.current.register(null);
      observer.disconnect();
      plot.destroy();
    };
  }, [shape, height, dark]);
  return <div ref={place} class="time-chart" style={{ minHeight: `${height}px` }} aria-hidden="true" />;
}

function options(width: number, now: { current: TimeChartProps }): uPlot.Options {
  const colour = colours();
  const { series, height } = now.current;
  const decimals = Math.min(...series.map((one) => one.decimals));
  const strokes = series.map((one, index) => {
    const number = one.thin ? index - series.length / 2 : index;
    return {
      colour: colour.series[number % colour.series.length] as string,
      width: one.thin ? 1 : 2,
      dash: DASHES[number % DASHES.length] as number[],
    };
  });
  const axis: uPlot.Axis = {
    stroke: colour.text,
    grid: { stroke: colour.grid, width: 1 },
    ticks: { stroke: colour.grid, width: 1 },
    font: colour.font,
  };
  const hands: Hands = {
    range: () => now.current.hands.range(),
    show: (range) => now.current.hands.show(range),
    zoom: (factor, centre) => now.current.hands.zoom(factor, centre),
    back: () => now.current.hands.back(),
  };
  return {
    width: Math.max(160, width),
    height,
    scales: {
      x: { time: false, auto: false },
      y: { range: (_plot, low, high) => atLeast(low, high, 20 * 10 ** -decimals) },
    },
    legend: { show: false },
    cursor: {
      y: false,
      points: { size: 7 },
      drag: { x: true, y: false, setScale: false },
      sync: { key: "time", setSeries: false },
    },
    hooks: {
      setCursor: [(plot) => now.current.onCursor((plot.cursor.left ?? -1) < 0 ? null : (plot.cursor.idx ?? null))],
    },
    plugins: [
      lines(strokes),
      overlays(() => now.current.overlays(), colour),
      gestures(hands),
      zoneAtAxis(() => now.current.zone ?? "", colour),
    ],
    axes: [
      {
        ...axis,
        size: 31, // ticks, gap, and a line of text with what hangs below it
        space: 90,
        incrs: INCREMENTS,
        values: (plot, places) => now.current.timeLabels(places, (plot.scales.x?.max ?? 0) - (plot.scales.x?.min ?? 0)),
      },
      { ...axis, size: 62, values: (_plot, splits) => splits.map((value) => fixed(value, decimals)) },
    ],
    series: [
      {},
      ...series.map((one, index) => ({
        label: one.label,
        stroke: strokes[index]?.colour as string, // of the point at the cursor
        paths: () => null,
        points: { show: false },
      })),
    ],
  };
}

/** Writes the zone of the times below the labels of the other axis, where nothing else is. */
function zoneAtAxis(read: () => string, colour: { text: string; font: string }): uPlot.Plugin {
  return {
    hooks: {
      drawAxes: ({ ctx, bbox }) => {
        ctx.save();
        ctx.fillStyle = colour.text;
        ctx.font = colour.font.replace(/^\d+px/, (size) => `${(parseFloat(size) - 1) * devicePixelRatio}px`);
        ctx.textAlign = "left";
        ctx.textBaseline = "top";
        ctx.fillText(read(), 2 * devicePixelRatio, bbox.top + bbox.height + 12 * devicePixelRatio);
        ctx.restore();
      },
    },
  };
}

/** Steps between labels of time, s. */
const INCREMENTS = [
  0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 86400,
];

/** A range that noise alone does not fill: at least so much from its lower to its upper end. */
export function atLeast(low: number | null, high: number | null, span: number): [number, number] {
  if (low === null || high === null) return [0, span];
  const margin = Math.max(0.08 * (high - low), (span - (high - low)) / 2);
  return [low - margin, high + margin];
}

/** Times of the day in the zone of this device, as exact as the span needs. */
export function clockLabels(places: number[], span: number): string[] {
  return places.map((place) => clock(place, span > 3 ? (span > 1200 ? 0 : 1) : 2));
}

/** A time of the day: 0 `14:05`, 1 `14:05:09`, 2 `14:05:09.25`. */
export function clock(utc: number, exact: 0 | 1 | 2): string {
  const date = new Date(Math.round(utc * 100) * 10);
  const two = (value: number): string => String(value).padStart(2, "0");
  const minutes = `${two(date.getHours())}:${two(date.getMinutes())}`;
  if (exact === 0) return minutes;
  const seconds = `${minutes}:${two(date.getSeconds())}`;
  return exact === 1 ? seconds : `${seconds}${spelt(`.${two(Math.floor(date.getMilliseconds() / 10))}`)}`;
}

/** Seconds since the first row. */
export function secondLabels(places: number[], span: number): string[] {
  return places.map((place) => `${fixed(place, span > 20 ? 0 : span > 2 ? 1 : 2)} s`);
}
