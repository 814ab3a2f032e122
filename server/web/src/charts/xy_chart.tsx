/** One signal over another (uPlot, mode 2), drawn again when its owner says so. */
import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import { fixed } from "../ui/format";
import { colours, theme } from "../ui/theme";
import type { Value } from "./trace";

export interface XyProps {
  xLabel: string;
  yLabel: string;
  read: () => { x: Value[]; y: Value[] };
  register: (draw: (() => void) | null) => void;
}

const HEIGHT = 360;

export function XyChart(props: XyProps) {
  const place = useRef<HTMLDivElement>(null);
  const now = useRef(props);
  now.current = props;
  const dark = theme.value;
  useEffect(() => {
    const element = place.current;
    if (element === null) return undefined;
    const plot = new uPlot(
      options(element.clientWidth, props),
      [null, [[], []]] as unknown as uPlot.AlignedData,
      element,
    );
    const draw = (): void => {
      const { x, y } = now.current.read();
      plot.setData([null, [x, y]] as unknown as uPlot.AlignedData);
    };
    now.current.register(draw);
    draw();
    const observer = new ResizeObserver(() => {
      if (element.clientWidth > 0 && element.clientWidth !== plot.width)
        plot.setSize({ width: element.clientWidth, height: HEIGHT });
    });
    observer.observe(element);
    return () => {
      now.current.register(null);
      observer.disconnect();
      plot.destroy();
    };
  }, [props.xLabel, props.yLabel, dark]);
  return <div ref={place} class="time-chart" style={{ minHeight: `${HEIGHT}px` }} aria-hidden="true" />;
}

/** Smallest and largest with a margin; equal ones apart. */
export function around(values: Value[]): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values)
    if (value !== null) {
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  if (low > high) return [0, 1];
  const margin = Math.max(0.05 * (high - low), 1e-6 * Math.max(1, Math.abs(high)));
  return [low - margin, high + margin];
}

function options(width: number, { xLabel, yLabel }: XyProps): uPlot.Options {
  const colour = colours();
  const axis: uPlot.Axis = {
    stroke: colour.text,
    grid: { stroke: colour.grid, width: 1 },
    ticks: { stroke: colour.grid, width: 1 },
    font: colour.font,
    labelFont: colour.font,
    labelSize: 22,
    values: (_plot, places) => places.map((place) => fixed(place, places.length > 1 ? decimals(places) : 2)),
  };
  const stroke = colour.series[0] as string;
  const range = (side: 0 | 1) => (plot: uPlot) =>
    around(((plot.data[1] as unknown as [Value[], Value[]] | undefined)?.[side] ?? []) as Value[]);
  return {
    mode: 2,
    width: Math.max(160, width),
    height: HEIGHT,
    legend: { show: false },
    cursor: { drag: { x: false, y: false } },
    scales: { x: { time: false, range: range(0) }, y: { range: range(1) } },
    axes: [
      { ...axis, label: xLabel },
      { ...axis, label: yLabel, size: 92 },
    ],
    series: [
      null,
      {
        facets: [
          { scale: "x", auto: true },
          { scale: "y", auto: true },
        ],
        stroke,
        paths: (plot: uPlot) => {
          const [x, y] = plot.data[1] as unknown as [Value[], Value[]];
          const line = new Path2D();
          let on = false;
          for (let row = 0; row < x.length; row += 1) {
            const [a, b] = [x[row] ?? null, y[row] ?? null];
            if (a === null || b === null) {
              on = false;
              continue;
            }
            const [left, top] = [plot.valToPos(a, "x", true), plot.valToPos(b, "y", true)];
            if (on) line.lineTo(left, top);
            else line.moveTo(left, top);
            on = true;
          }
          const { ctx } = plot;
          ctx.save();
          ctx.strokeStyle = stroke;
          ctx.lineWidth = 1.5;
          ctx.stroke(line);
          ctx.restore();
          return null;
        },
      },
    ] as unknown as uPlot.Series[],
  };
}

function decimals(places: number[]): number {
  const step = Math.abs((places[1] as number) - (places[0] as number));
  return Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9)));
}
