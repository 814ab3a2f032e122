/** What is drawn over the lines: thresholds, marks of what happened, and where values were not measured. */
import type uPlot from "uplot";
import type { Run } from "./trace";

/** Something that happened: at `from`, until `to` if it lasted. */
export interface ChartMark {
  from: number;
  to?: number | null;
  kind: "alarm" | "event" | "recording";
  text: string;
}
export interface Threshold {
  value: number;
  label: string;
}
export interface Overlays {
  marks: ChartMark[];
  thresholds: Threshold[];
  doubtful: Run[];
}
export interface OverlayColours {
  bad: string;
  warning: string;
  accent: string;
  font: string;
}

export const LETTERS = { alarm: "A", event: "E", recording: "R" } as const;
const BAR = 5;

/** A uPlot plug-in that draws what `read` gives at each drawing. */
export function overlays(read: () => Overlays, colours: OverlayColours): uPlot.Plugin {
  const tone = { alarm: colours.bad, event: colours.warning, recording: colours.accent };
  return {
    hooks: {
      draw: (plot) => {
        const { ctx, bbox } = plot;
        const { marks, thresholds, doubtful } = read();
        const low = plot.scales.x?.min ?? 0;
        const high = plot.scales.x?.max ?? 0;
        const x = (time: number): number => plot.valToPos(Math.min(high, Math.max(low, time)), "x", true);
        ctx.save();
        ctx.beginPath();
        ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
        ctx.clip();
        ctx.font = colours.font;
        for (const { value, label } of thresholds) threshold(plot, value, label, colours.bad);
        for (const mark of marks) {
          const to = mark.to ?? mark.from;
          if (to < low || mark.from > high) continue;
          line(ctx, x(mark.from), bbox, tone[mark.kind], mark.from >= low ? LETTERS[mark.kind] : "", x(to));
        }
        ctx.fillStyle = colours.bad;
        for (const [from, to] of doubtful) {
          if (to < low || from > high) continue;
          ctx.fillRect(x(from), bbox.top + bbox.height - BAR, Math.max(2, x(to) - x(from)), BAR);
        }
        ctx.restore();
      },
    },
  };
}

function threshold(plot: uPlot, value: number, label: string, colour: string): void {
  const { ctx, bbox } = plot;
  const y = plot.valToPos(value, "y", true);
  if (y < bbox.top - 1 || y > bbox.top + bbox.height + 1) return;
  ctx.strokeStyle = ctx.fillStyle = colour;
  ctx.lineWidth = 1.5;
  ctx.setLineDash([10, 4]);
  ctx.beginPath();
  ctx.moveTo(bbox.left, y);
  ctx.lineTo(bbox.left + bbox.width, y);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.textAlign = "right";
  ctx.textBaseline = y - bbox.top > 20 ? "bottom" : "top";
  ctx.fillText(label, bbox.left + bbox.width - 4, y - (y - bbox.top > 20 ? 2 : -2));
}

function line(
  ctx: CanvasRenderingContext2D,
  at: number,
  bbox: uPlot.BBox,
  colour: string,
  letter: string,
  to: number,
): void {
  ctx.strokeStyle = ctx.fillStyle = colour;
  if (to - at > 1) {
    ctx.globalAlpha = 0.12;
    ctx.fillRect(at, bbox.top, to - at, bbox.height);
    ctx.globalAlpha = 1;
  }
  if (letter === "") return;
  ctx.lineWidth = 1.5;
  ctx.setLineDash([3, 3]);
  ctx.beginPath();
  ctx.moveTo(at, bbox.top);
  ctx.lineTo(at, bbox.top + bbox.height);
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.textAlign = "left";
  ctx.textBaseline = "top";
  ctx.fillText(letter, at + 3, bbox.top + 2);
}
