/**
 * Lines over time as pixels, column by column.
 *
 * Without a graphics processor a canvas takes more than a frame's time to stroke a few long lines wider than a pixel. A
 * line that never goes back in time is known by where it is in each column, which takes a tenth of that.
 */
import uPlot from "uplot";
import type { Range } from "./range";
import type { Value } from "./trace";

export interface Stroke {
  /** `#rgb` or `#rrggbb`. */
  colour: string;
  /** Device pixels. */
  width: number;
  /** Device pixels along the time axis: on, off, on, ... */
  dash: readonly number[];
}

/** Pixels without premultiplied opacity, rows from the top; in memory red is first. */
export interface Picture {
  width: number;
  height: number;
  pixels: Uint32Array;
}

/** What is given for a row of another recording: the line goes on through it, where null ends it. */
type Row = Value | undefined;

/** Numbers of each column of pixels, kept from one drawing to the next: what is made anew for each has to be cleared away. */
class Columns {
  /** From which to which height a line is; NaN where it is not. */
  low = new Float64Array(0);
  high = new Float64Array(0);
  /** Upper and lower edge of the line as it is drawn. */
  top = new Float64Array(0);
  bottom = new Float64Array(0);
  on = new Uint8Array(0);
  /** Whether an edge is that of a peak: 1 of one above, 2 of one below. */
  peak = new Uint8Array(0);

  ofWidth(width: number): void {
    if (this.low.length !== width) {
      this.low = new Float64Array(width);
      this.high = new Float64Array(width);
      this.top = new Float64Array(width);
      this.bottom = new Float64Array(width);
      this.on = new Uint8Array(width);
      this.peak = new Uint8Array(width);
    }
    this.low.fill(NaN);
    this.high.fill(NaN);
    this.top.fill(NaN);
    this.bottom.fill(NaN);
  }
}

const columns = new Columns();

/** Find out where a line is; `x` and `y` are the values at the ends of a picture of `width` and `height`. */
function follow(t: number[], values: Row[], x: Range, y: Range, width: number, height: number): void {
  const { low, high } = columns;
  const right = width / (x[1] - x[0]);
  const up = height / (y[1] - y[0]);
  let x0 = NaN;
  let y0 = NaN;
  let from = firstAfter(t, x[0]) - 1;
  while (from > 0 && values[from] === undefined) from -= 1;
  for (let row = Math.max(0, from); row < t.length; row += 1) {
    const value = values[row];
    if (value === undefined) continue;
    if (value === null || !Number.isFinite(value)) {
      x0 = NaN;
      continue;
    }
    const x1 = ((t[row] as number) - x[0]) * right;
    const y1 = (y[1] - value) * up;
    const alone = Number.isNaN(x0);
    const slope = !alone && x1 > x0 ? (y1 - y0) / (x1 - x0) : 0;
    const first = Math.max(0, Math.floor(alone ? x1 : x0));
    const last = Math.min(width - 1, Math.floor(x1));
    for (let column = first; column <= last; column += 1) {
      const enters = alone ? y1 : column > x0 ? y0 + slope * (column - x0) : y0;
      const leaves = column + 1 < x1 ? y0 + slope * (column + 1 - x0) : y1;
      const above = enters < leaves ? enters : leaves;
      const below = enters < leaves ? leaves : enters;
      if (!((low[column] as number) <= above)) low[column] = above;
      if (!((high[column] as number) >= below)) high[column] = below;
    }
    x0 = x1;
    y0 = y1;
    if (x1 > width) break;
  }
}

/** Draw a line into a picture; `x` and `y` are the values at its left and right, lower and upper ends. */
export function drawLine(picture: Picture, t: number[], values: Row[], x: Range, y: Range, stroke: Stroke): void {
  const { width, height, pixels } = picture;
  if (!(x[1] > x[0]) || !(y[1] > y[0])) return;
  columns.ofWidth(width);
  follow(t, values, x, y, width, height);
  const { low, high, top, bottom, on, peak } = columns;
  const half = stroke.width / 2;
  const reach = Math.ceil(half);
  for (let column = 0; column < width; column += 1) {
    const above = low[column] as number;
    const below = high[column] as number;
    if (Number.isNaN(above)) continue;
    let highest = above;
    let lowest = below;
    const end = Math.min(width - 1, column + reach);
    for (let next = Math.max(0, column - reach); next <= end; next += 1) {
      if ((low[next] as number) < highest) highest = low[next] as number;
      if ((high[next] as number) > lowest) lowest = high[next] as number;
    }
    // As wide across its direction as it is where it is level, but a peak is no higher than it is.
    const across = half * Math.sqrt(1 + (below - above) * (below - above));
    const middle = (above + below) / 2;
    top[column] = Math.max(middle - across, highest - half);
    bottom[column] = Math.min(middle + across, lowest + half);
    peak[column] = (middle - across < highest - half ? 1 : 0) + (middle + across > lowest + half ? 2 : 0);
  }
  dashes(on, stroke.dash, (x[0] * width) / (x[1] - x[0]));
  const colour = abgr(stroke.colour);
  for (let column = 0; column < width; column += 1) {
    const upper = top[column] as number;
    const lower = bottom[column] as number;
    if (Number.isNaN(upper) || on[column] === 0) continue;
    const fadesAbove = ((peak[column] as number) & 1) === 1 ? 1 : fades(top, column);
    const fadesBelow = (peak[column] as number) > 1 ? 1 : fades(bottom, column);
    const first = Math.max(0, Math.floor(upper - fadesAbove / 2));
    const last = Math.min(height - 1, Math.floor(lower + fadesBelow / 2));
    for (let row = first; row <= last; row += 1) {
      const from = 0.5 + (row + 0.5 - upper) / fadesAbove;
      const to = 0.5 + (lower - row - 0.5) / fadesBelow;
      const covered = from < to ? from : to;
      if (covered <= 0) continue;
      const at = row * width + column;
      if (covered >= 1) pixels[at] = 0xff000000 | colour;
      else pixels[at] = blended(pixels[at] as number, colour, covered);
    }
  }
}

/** Rows over which an edge fades: as far as it rises from one column to the next. */
function fades(heights: Float64Array, column: number): number {
  const rise = Math.abs((heights[column + 1] as number) - (heights[column - 1] as number)) / 2;
  return rise > 1 ? rise : 1; // also where there is no neighbour
}

/** Which columns a dashed line is in. The pattern stands still in time, so it moves with the line. */
function dashes(on: Uint8Array, dash: readonly number[], start: number): void {
  let length = 0;
  for (const part of dash) length += part;
  if (!(length > 0)) {
    on.fill(1);
    return;
  }
  let part = 0;
  let rest = ((start % length) + length) % length;
  while (rest >= (dash[part % dash.length] as number)) rest -= dash[part++ % dash.length] as number;
  for (let column = 0; column < on.length; column += 1) {
    on[column] = part % 2 === 0 ? 1 : 0;
    rest += 1;
    while (rest >= (dash[part % dash.length] as number)) rest -= dash[part++ % dash.length] as number;
  }
}

/** A colour over what is there, `covered` of it. */
function blended(under: number, colour: number, covered: number): number {
  const below = (under >>> 24) / 255;
  if (below === 0) return (Math.round(255 * covered) << 24) | colour;
  const left = below * (1 - covered);
  const both = covered + left;
  const red = ((colour & 255) * covered + (under & 255) * left) / both;
  const green = (((colour >>> 8) & 255) * covered + ((under >>> 8) & 255) * left) / both;
  const blue = (((colour >>> 16) & 255) * covered + ((under >>> 16) & 255) * left) / both;
  return (Math.round(255 * both) << 24) | (Math.round(blue) << 16) | (Math.round(green) << 8) | Math.round(red);
}

function abgr(colour: string): number {
  const short = /^#([0-9a-f])([0-9a-f])([0-9a-f])$/i.exec(colour);
  const full =
    short === null
      ? colour.slice(1)
      : short
          .slice(1)
          .map((digit) => digit + digit)
          .join("");
  const rgb = Number.parseInt(full, 16) || 0;
  return ((rgb & 255) << 16) | (rgb & 0xff00) | (rgb >>> 16);
}

/** Index of the first time that is not before `start`. */
function firstAfter(t: number[], start: number): number {
  let [low, high] = [0, t.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((t[middle] as number) < start) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** What all plots draw their lines in before they show them; one is drawn at a time. */
let shared: { context: CanvasRenderingContext2D; image: ImageData; picture: Picture } | null = null;

function board(width: number, height: number): typeof shared {
  if (shared !== null && shared.picture.width === width && shared.picture.height === height) {
    shared.picture.pixels.fill(0);
    return shared;
  }
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (context === null) return null;
  const image = context.createImageData(width, height);
  shared = { context, image, picture: { width, height, pixels: new Uint32Array(image.data.buffer) } };
  return shared;
}

/** A uPlot plug-in that draws all series; their own `paths` draw nothing. `strokes`: in CSS pixels. */
export function lines(strokes: readonly Stroke[]): uPlot.Plugin {
  return {
    hooks: {
      draw: (plot) => {
        const { left, top, width, height } = plot.bbox;
        const [x, y] = [plot.scales.x, plot.scales.y];
        const there = width >= 1 && height >= 1 ? board(Math.round(width), Math.round(height)) : null;
        if (there === null || x?.min == null || x.max == null || y?.min == null || y.max == null) return;
        const [t, ...values] = plot.data as unknown as [number[], ...Row[][]];
        strokes.forEach(({ colour, width: css, dash }, index) => {
          const [wide, dashed] = [css * uPlot.pxRatio, dash.map((part) => part * uPlot.pxRatio)];
          const stroke = { colour, width: wide, dash: dashed };
          const [xs, ys] = [[x.min, x.max] as Range, [y.min, y.max] as Range];
          drawLine(there.picture, t, values[index] ?? [], xs, ys, stroke);
        });
        there.context.putImageData(there.image, 0, 0);
        plot.ctx.drawImage(there.context.canvas, left, top);
      },
    },
  };
}
