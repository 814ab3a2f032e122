import { describe, expect, it } from "vitest";
import { drawLine, type Picture, type Stroke } from "./lines";
import type { Range } from "./range";

const SIZE = 40;
const STROKE: Stroke = { colour: "#0b5cad", width: 2, dash: [] };
const ALL: Range = [0, SIZE];

/** Values at times 0, 1, ..., one device pixel each, on a picture as high and wide as `SIZE`. */
function drawn(values: (number | null | undefined)[], stroke = STROKE, x = ALL, t = values.map((_, row) => row)) {
  const picture: Picture = { width: SIZE, height: SIZE, pixels: new Uint32Array(SIZE * SIZE) };
  drawLine(picture, t, values, x, ALL, stroke);
  return picture;
}
const opacity = (picture: Picture, column: number, row: number): number =>
  (picture.pixels[row * SIZE + column] as number) >>> 24;
/** How many rows of a column are covered, all in all. */
const covered = (picture: Picture, column: number): number =>
  Array.from({ length: SIZE }, (_, row) => opacity(picture, column, row) / 255).reduce((sum, one) => sum + one, 0);
const level = (value: number): number[] => new Array<number>(SIZE + 1).fill(value);

describe("lines as pixels", () => {
  it("are as wide as they should be, where they should be, in their colour", () => {
    const picture = drawn(level(30));
    expect([8, 9, 10, 11].map((row) => opacity(picture, 20, row))).toEqual([0, 255, 255, 0]);
    expect((picture.pixels[9 * SIZE + 20] as number).toString(16)).toBe("ffad5c0b"); // opacity, blue, green, red
  });

  it("cover parts of a pixel in part", () => {
    const picture = drawn(level(30.25));
    expect([8, 9, 10].map((row) => opacity(picture, 20, row))).toEqual([64, 255, 191]);
  });

  it.each([0, 0.3, 1, 3, 8])("are as wide across their direction at a slope of %d", (slope) => {
    const picture = drawn(level(0).map((_, row) => 20 + slope * (row - 20)));
    expect(covered(picture, 20) / (2 * Math.hypot(1, slope))).toBeCloseTo(1, 0.9);
  });

  it("show a peak of a single row, and no higher than it is", () => {
    const picture = drawn(level(10).map((value, row) => (row === 20 ? 35 : value)));
    expect(opacity(picture, 20, 4)).toBeGreaterThan(60);
    for (let column = 0; column < SIZE; column += 1) expect(opacity(picture, column, 2)).toBe(0);
  });

  it("show the smallest and the largest of many rows in one column", () => {
    const t = Array.from({ length: 4000 }, (_, row) => row / 100);
    const picture = drawn(
      t.map((_, row) => (row % 2 === 0 ? 10 : 30)),
      STROKE,
      ALL,
      t,
    );
    expect(covered(picture, 20)).toBeCloseTo(22, 0);
  });

  it("end where nothing was measured, and go on where only another recording has a row", () => {
    const without = (nothing: null | undefined) =>
      drawn(level(20).map((value, row) => (row > 10 && row < 20 ? nothing : value)));
    expect(covered(without(null), 15)).toBe(0);
    expect(covered(without(undefined), 15)).toBeCloseTo(2, 6);
  });

  it("reach the ends of a range that lies between rows", () => {
    const picture = drawn([20, 20, 20], STROKE, ALL, [-100, 15, 100]);
    expect([0, 14, 16, SIZE - 1].map((column) => covered(picture, column))).toEqual([2, 2, 2, 2]);
  });

  it("carry their dashes along as time goes on", () => {
    const stroke = { ...STROKE, dash: [3, 2] };
    const at = (from: number): string => {
      const picture = drawn(
        level(20),
        stroke,
        [from, from + SIZE],
        level(20).map((_, row) => row + from),
      );
      return Array.from({ length: 12 }, (_, column) => (covered(picture, column) > 0 ? "x" : "-")).join("");
    };
    expect(at(0)).toBe("xxx--xxx--xx");
    expect(at(1)).toBe("xx--xxx--xxx");
    expect(at(-1)).toBe("-xxx--xxx--x");
  });

  it("blend where they cross", () => {
    const picture = drawn(level(30.5));
    drawLine(
      picture,
      level(0).map((_, row) => row),
      level(30.5),
      ALL,
      ALL,
      { ...STROKE, colour: "#fff" },
    );
    expect(opacity(picture, 20, 8)).toBe(192);
    expect(picture.pixels[9 * SIZE + 20]).toBe(0xffffffff);
  });

  it("of no range or no rows are nothing", () => {
    for (const picture of [drawn([]), drawn([1, 2], STROKE, [1, 1])]) expect(Math.max(...picture.pixels)).toBe(0);
  });
});
