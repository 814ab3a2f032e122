import { expect, it } from "vitest";
import { Trace } from "../../charts/trace";
import { chosen, readChoice } from "./choice";
import { column, groups, type MachineContent } from "./groups";
import { marksOf } from "./marks";
import { joined, played } from "../recordings/replay_trace";

const machine: MachineContent = {
  channels: [
    { name: "j.head", quantity: "head_pressure", joint: "j", unit: "bar", range: [0, 250] },
    { name: "j.rod", quantity: "rod_pressure", joint: "j", unit: "bar" },
  ],
  joints: [{ name: "j", cylinder: { bore: 0.1, rod: 0.05 } }],
};
const trace = (moment: number, times: number[], head: number[], rod: number[]): Trace => {
  const made = new Trace(["j.head", "j.rod"], moment);
  times.forEach((time, row) => made.append(time, made.names, [head[row] as number, rod[row] as number], () => true));
  return made;
};

it("gives the force that pressures amount to, and within a moment all that they allow", () => {
  const force = groups(machine)[2]!.lines[0]!;
  const [piston, annulus] = [(Math.PI / 4) * 0.01, (Math.PI / 4) * (0.01 - 0.0025)];
  const rows = column(force, trace(0, [1, 1.02], [100, 110], [20, 10]));
  expect(rows[0]).toBeCloseTo((100 * piston - 20 * annulus) * 100, 6);
  const [low, high] = column(force, trace(1, [1.1, 1.2], [100, 110], [20, 10]));
  expect(low).toBeCloseTo((100 * piston - 20 * annulus) * 100, 6);
  expect(high).toBeCloseTo((110 * piston - 10 * annulus) * 100, 6);
});

it("draws the ends of a channel's range, and only what was chosen", () => {
  expect(groups(machine)[0]!.lines[0]!.limits.map((limit) => limit.value)).toEqual([0, 250]);
  const left = chosen(groups(machine), ["j.head", "j.force"]);
  expect(left.map((group) => group.lines.map((line) => line.name))).toEqual([["j.rod"]]);
});

it("reads what a device remembers, whatever it is", () => {
  expect(readChoice('{"hidden":["a"],"thresholds":{"Supply":[3,null]}}')).toEqual({
    hidden: ["a"],
    thresholds: { Supply: [3] },
  });
  expect(readChoice("{")).toEqual({ hidden: [], thresholds: {} });
});

it("marks alarms of this machine from when they came to when they went, and recordings that were made here", () => {
  const alarm = { machine: "arm", raised: "2026-01-01T00:00:10Z", cleared: null, text: "hot" };
  const recording = { origin: "recorded", created: "2026-01-01T00:00:20Z", ended: "2026-01-01T00:00:30Z", label: "x" };
  const marks = marksOf(
    "arm",
    [alarm, { ...alarm, machine: "other" }] as never[],
    [recording, { ...recording, origin: "uploaded" }] as never[],
  );
  expect(marks.map((mark) => [mark.kind, mark.from % 60, mark.to! % 60 === 30])).toEqual([
    ["recording", 20, true],
    ["alarm", 10, false],
  ]);
});

it("puts two recordings on one line of time, and a replay stops at the end", () => {
  const group = groups(machine)[0]!;
  const both = joined(group, trace(0, [0, 0.2], [1, 2], [0, 0]), trace(0, [0.1, 0.2], [7, 8], [0, 0]));
  expect(both.t).toEqual([0, 0.1, 0.2]);
  expect(both.columns[0]).toEqual([1, undefined, 2]);
  expect(both.columns[1]).toEqual([undefined, 7, 8]);
  expect(played([0, 20], 5, 22)).toEqual([2, 22]);
});
