import { expect, it } from "vitest";
import { panned, within, zoomed } from "./range";
import { type Signals, Trace } from "./trace";

const good = () => true;
const signals = (moment: number, time: number[], low: (number | null)[], high: (number | null)[] | null): Signals => ({
  start: 0,
  end: 100,
  moment_s: moment,
  first_utc: null,
  time,
  channels: { a: { unit: "bar", low, high, doubtful: [] } },
});

it("appends rows after those that the service remembered, and drops what it has already", () => {
  const trace = Trace.of(signals(0, [10, 10.02, 10.04], [1, 2, 3], null));
  for (const [time, value] of [
    [10.02, 2],
    [10.04, 3],
    [10.06, 4],
  ] as const)
    trace.append(time, ["b", "a"], [99, value], good);
  expect(trace.t).toEqual([10, 10.02, 10.04, 10.06]);
  expect(trace.columns.get("a")).toEqual([1, 2, 3, 4]);
});

it("draws the smallest and the largest of a moment, and widens the last one by rows that come", () => {
  const trace = Trace.of(signals(1, [10.5, 11.5], [1, 2], [5, 6]));
  trace.append(11.9, ["a"], [9], good);
  trace.append(12.1, ["a"], [4], good);
  trace.append(12.2, ["a"], [3], good);
  expect(trace.t).toEqual([10.25, 10.75, 11.25, 11.75, 12.25, 12.75]);
  expect(trace.columns.get("a")).toEqual([1, 5, 2, 9, 3, 4]);
});

it("leaves a gap where nothing was measured, for rows and for moments", () => {
  const rows = Trace.of(signals(0, [1, 1.02], [1, 1], null));
  rows.append(3, ["a"], [2], good);
  expect(rows.columns.get("a")).toEqual([1, 1, null, 2]);
  const moments = Trace.of(signals(1, [1.5, 2.5, 6.5], [1, 1, 1], [2, 2, 2]));
  expect(moments.columns.get("a")).toEqual([1, 2, 1, 2, null, null, 1, 2]);
  expect([...moments.t].sort((a, b) => a - b)).toEqual(moments.t);
});

it("marks from when to when a value was not measured", () => {
  const trace = new Trace(["a"]);
  for (let row = 0; row < 20; row += 1) trace.append(row / 10, ["a"], [row], () => row < 5 || (row > 9 && row < 18));
  expect(trace.doubtful.get("a")).toEqual([
    [0.5, 0.9],
    [1.8, 1.9],
  ]);
});

it("begins anew when the machine's clock was set back, and forgets what is older than its span", () => {
  const trace = new Trace(["a"]);
  trace.append(100, ["a"], [1], good);
  trace.append(50, ["a"], [2], good);
  expect(trace.t).toEqual([50]);
  for (let row = 1; row <= 3000; row += 1) trace.append(50 + row / 50, ["a"], [row], good);
  trace.trim(10);
  expect(trace.t[0]).toBeGreaterThanOrEqual(100);
  expect(trace.columns.get("a")?.length).toBe(trace.t.length);
});

it("zooms around the place that was pointed at, and never leaves what is remembered", () => {
  expect(zoomed([0, 100], 0.5, 25, [0, 100])).toEqual([12.5, 62.5]);
  expect(zoomed([0, 100], 4, 25, [0, 100])).toEqual([0, 100]);
  const [from, to] = zoomed([10, 10.2], 0.001, 10.1, [0, 100]);
  expect(to - from).toBeCloseTo(0.2);
  expect(panned([10, 20], -50, [0, 100])).toEqual([0, 10]);
  expect(within([95, 105], [0, 100])).toEqual([90, 100]);
});
