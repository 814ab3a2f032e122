import { describe, expect, it } from "vitest";
import { progress, type WatchedMachine, watchedChannels } from "./motion_watch";

const MACHINE: WatchedMachine = {
  joints: [
    { name: "a", limits: { position: [-1, 1], velocity: 0.5 }, cylinder: { stroke: 0.4 } },
    { name: "b", limits: { position: [-1, 1], velocity: 0.5 } },
  ],
};
const channel = (joint: string, quantity: string, unit: string) => ({
  name: `${joint}.${quantity}`,
  joint,
  quantity,
  unit,
});
const ANGLES = [channel("a", "joint_position", "rad"), channel("b", "joint_position", "deg")];
const PISTON = channel("a", "piston_position", "mm");

/** Rows at 50 Hz from `start` on, s; a little noise, as every sensor has. */
function signals(start: number, seconds: number, of: Record<string, (t: number) => number | null>) {
  const time = Array.from({ length: Math.round(50 * seconds) }, (_, row) => start + row / 50);
  const channels = Object.fromEntries(
    Object.entries(of).map(([name, value]) => [
      name,
      {
        unit: "",
        low: time.map((t, row) => {
          const known = value(t);
          return known === null ? null : known + 0.001 * Math.sin(17 * row);
        }),
        high: null,
        doubtful: [],
      },
    ]),
  );
  return { start, end: start + seconds, moment_s: 0, first_utc: null, time, channels };
}

describe("a motion that is recorded", () => {
  const still = (): number => 0.2;
  const swing = (t: number): number => (t < 110 || t > 130 ? 0 : 0.5 * Math.sin((2 * Math.PI * (t - 110)) / 10));

  it("is waited for while nothing moves, however long", () => {
    const found = progress(
      signals(100, 60, { "a.joint_position": still, "b.joint_position": still }),
      ANGLES,
      MACHINE,
      100,
    );
    expect(found?.moved).toBe(false);
  });

  it("is over for as long as nothing has moved since", () => {
    const seen = (seconds: number) =>
      progress(signals(100, seconds, { "a.joint_position": swing, "b.joint_position": still }), ANGLES, MACHINE, 100);
    expect([seen(20)?.moved, seen(20)?.rest]).toEqual([true, expect.closeTo(0, 0)]);
    expect(seen(38)?.rest).toBeCloseTo(8, 0);
  });

  it("is not over while another joint moves, nor by what was before the recording", () => {
    const late = (t: number): number => (t > 136 ? 10 : 0);
    const both = { "a.joint_position": swing, "b.joint_position": late };
    expect(progress(signals(100, 38, both), ANGLES, MACHINE, 100)?.rest).toBeLessThan(2.1);
    expect(progress(signals(100, 60, { "a.joint_position": swing }), ANGLES, MACHINE, 135)?.moved).toBe(false);
    expect(progress(signals(100, 60, { "a.joint_position": swing }), ANGLES, MACHINE, 170)).toBeNull();
  });

  it("has covered shares of range and speed", () => {
    const found = progress(
      signals(100, 38, { "a.joint_position": swing, "b.joint_position": () => null }),
      ANGLES,
      MACHINE,
      100,
    );
    expect(found?.coverage.length).toBe(1); // nothing is said of what is not measured
    expect(found?.coverage[0]?.range).toBeCloseTo(1 / 2, 2); // -0.5 to 0.5 of -1 to 1
    expect(found?.coverage[0]?.speed).toBeCloseTo((0.5 * 2 * Math.PI) / 10 / 0.5, 1);
  });

  it("of free cylinders has covered a share of the stroke", () => {
    expect(watchedChannels([...ANGLES, PISTON], true)).toEqual([PISTON]);
    expect(watchedChannels(ANGLES, true)).toEqual(ANGLES);
    const found = progress(signals(100, 30, { [PISTON.name]: (t) => 100 + 100 * Math.sin(t) }), [PISTON], MACHINE, 100);
    expect(found?.coverage[0]?.range).toBeCloseTo(0.5, 2);
  });

  it("is read from moments as from rows", () => {
    const moments = {
      ...signals(100, 0, {}),
      moment_s: 1,
      time: [100.5, 101.5, 102.5, 103.5],
      channels: {
        "a.joint_position": { unit: "rad", low: [0, -0.4, 0.1, 0.1], high: [0, 0.4, 0.1, 0.1], doubtful: [] },
      },
    };
    const found = progress(moments, ANGLES, MACHINE, 100);
    expect(found?.coverage[0]?.range).toBeCloseTo(0.4);
    expect(found?.rest).toBeCloseTo(2);
  });
});
