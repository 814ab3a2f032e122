import { describe, expect, it } from "vitest";
import { cloud, friction, interpolated } from "./drawn";
import { type Report, type Scatter, readReport } from "./report";
import content from "./report.fixture.json";

const report = readReport(content) as Report;
const scatter = report.figures.scatter[0] as Scatter;

describe("a cloud", () => {
  it("rises along the variable and keeps every point once", () => {
    const drawn = cloud(scatter);
    expect([...drawn.before.x].sort((a, b) => a - b)).toEqual(drawn.before.x);
    const still = (scatter.direction ?? []).filter((way) => way === 0).length;
    const points = drawn.before.series.filter((one) => one.kind === "points");
    const shown = points.flatMap((one) => one.values.filter((value) => value !== null));
    expect(shown.length).toBe(scatter.x.length - still);
    for (const value of shown) expect(scatter.before).toContain(value);
  });

  it("draws both ways apart where the law has a direction, else together", () => {
    expect(cloud(scatter).after.series.map((one) => one.label)).toEqual(["speed > 0", "speed < 0"]);
    const even = cloud({ ...scatter, direction: null, law_back: null });
    expect(even.after.series.map((one) => one.label)).toEqual(["samples"]);
    expect(even.before.series.map((one) => one.label)).toEqual(["samples", "law found, ±2 std"]);
  });

  it("has one scale before and after, which holds all points, the law and zero", () => {
    // Friction that grows with the load had stood in Coulomb friction: its law lies far from the points.
    const far = { ...scatter, law_y: scatter.law_y.map(() => 1e4) };
    const { range, before, after } = cloud(far);
    for (const value of [0, ...[...before.series, ...after.series].flatMap((one) => one.values)]) {
      if (value === null) continue;
      expect(value).toBeGreaterThan(range[0]);
      expect(value).toBeLessThan(range[1]);
    }
  });

  it("tells how wide it is", () => {
    const flat = cloud({
      ...scatter,
      before: scatter.x.map((_, at) => (at % 2 ? 1 : -1)),
      after: scatter.x.map(() => 3),
    });
    expect(flat.spread.before).toBeCloseTo(1, 1);
    expect(flat.spread.after).toBe(0);
  });

  it("leaves out what is not known", () => {
    const holes = cloud({
      ...scatter,
      x: [null, ...scatter.x.slice(1)],
      law_x: [],
      law_y: [],
      law_std: [],
      law_back: [],
    });
    expect(holes.before.x.length).toBe(scatter.x.length - 1);
    expect(holes.before.series.every((one) => one.kind === "points")).toBe(true);
  });
});

describe("interpolation", () => {
  it("is exact on a straight line, and null outside of it", () => {
    expect(interpolated([0, 1, 3], [1, 3, 7], [-0.1, 0, 0.5, 1, 2, 3, 3.1])).toEqual([null, 1, 2, 3, 5, 7, null]);
  });

  it("is null beside what is not known", () => {
    expect(interpolated([0, 1, 2], [0, null, 2], [0.5, 1.5])).toEqual([null, null]);
  });
});

describe("friction", () => {
  it("has a band of two standard deviations, and the curve after where it changed", () => {
    const curve = report.figures.friction[1];
    if (curve === undefined) throw new Error("no curve");
    const [first, after] = friction(curve).series;
    const [force, std] = [curve.force[2] as number, curve.std[2] as number];
    expect(first?.band?.[0][2]).toBeCloseTo(force - 2 * std);
    expect(first?.band?.[1][2]).toBeCloseTo(force + 2 * std);
    expect(after?.values).toEqual(curve.after);
    expect(friction({ ...curve, after: null }).series.length).toBe(1);
  });
});
