import { describe, expect, it } from "vitest";
import { type Calibration, before, history, jointErrors, possible } from "./rules";

type Given = Partial<Calibration>;
export const calibration = (given: Given): Calibration => ({
  id: "cal-1",
  machine: "arm",
  identification: "idn-1",
  valves: null,
  label: "Spring",
  state: "proposed",
  proposed_by: "Tablet",
  proposed_by_id: "prn-tablet",
  approved_by: null,
  created: "2026-03-01T08:00:00Z",
  activated: null,
  verdict: "effect_added",
  overall: { change_percent: -33 },
  errors: {},
  parameters: [],
  note: "",
  history: [],
  ...given,
});
const me = { id: "prn-me", name: "Me", role: "engineer", kind: "device", machines: null, approves_own: false } as const;

describe("what may be done", () => {
  it("depends on the state", () => {
    const offered = (state: Calibration["state"]) => {
      const { approve, reject, activate } = possible(calibration({ state }), me, true);
      return [approve, reject, activate];
    };
    expect(offered("proposed")).toEqual([true, true, false]);
    expect(offered("approved")).toEqual([false, true, true]);
    expect(offered("active")).toEqual([false, false, false]);
    expect(offered("retired")).toEqual([false, false, true]);
    expect(offered("rejected")).toEqual([false, false, false]);
  });

  it("needs a second person to approve, by who they are and not by their name", () => {
    const own = possible(calibration({ proposed_by_id: "prn-me" }), me, true);
    expect([own.approve, own.reject]).toEqual([false, true]);
    expect(own.why).toContain("another engineer");
    expect(possible(calibration({ proposed_by: "Me" }), me, true).approve).toBe(true);
    const alone = { ...me, approves_own: true };
    expect(possible(calibration({ proposed_by_id: "prn-me" }), alone, true).approve).toBe(true);
  });

  it("is nothing without the role, and says whose it is", () => {
    const may = possible(calibration({}), me, false);
    expect([may.approve, may.reject, may.activate]).toEqual([false, false, false]);
    expect(may.why).toContain("engineer");
  });
});

describe("history", () => {
  const first = calibration({ id: "a", state: "retired", activated: "2026-03-02T08:00:00Z", approved_by: "Kim" });
  const second = calibration({
    id: "b",
    label: "Summer",
    state: "active",
    created: "2026-06-01T08:00:00Z",
    activated: "2026-06-02T08:00:00Z",
  });

  it("is newest first", () => {
    const texts = history([second, first]).map((step) => step.text);
    expect(texts).toEqual([
      "“Summer” came into use",
      "“Summer” was proposed by Tablet",
      "“Spring” came into use, approved by Kim",
      "“Spring” was proposed by Tablet",
    ]);
  });

  it("says who and when, and that it was the same person", () => {
    const time = "2026-03-01T08:00:00Z";
    const steps = [
      { time, action: "proposed", by: "Tablet", note: "" },
      { time: "2026-03-01T09:00:00Z", action: "approved", by: "Tablet", note: "as measured" },
      { time: "2026-03-01T10:00:00Z", action: "activated", by: "Kim", note: "" },
    ] satisfies Calibration["history"];
    expect(history([calibration({ history: steps })]).map((step) => step.text)).toEqual([
      "“Spring” came into use, by Kim",
      "“Spring” was approved, by Tablet, who had proposed it: as measured",
      "“Spring” was proposed, by Tablet",
    ]);
  });

  it("knows what rolling back leads to", () => {
    const oldest = calibration({ id: "o", state: "retired", activated: "2026-01-02T08:00:00Z" });
    expect(before([second, oldest, first])?.id).toBe("a");
    expect(before([second])).toBeNull();
  });

  it("does not lead to one whose use was undone", () => {
    type Steps = [string, "activated" | "retired", string][];
    const told = (id: string, steps: Steps) =>
      calibration({
        id,
        activated: steps[0]?.[0] ?? null,
        history: steps.map(([time, action, note]) => ({ time, action, note, by: "Kim" })),
      });
    const first: Steps = [["01", "activated", ""]];
    expect(before([told("a", first)])).toBeNull();
    const replaced: Steps = [...first, ["02", "retired", ""]];
    const newer: Steps = [["03", "activated", ""]];
    expect(before([told("a", replaced), told("b", newer)])?.id).toBe("a");
    const again: Steps = [...replaced, ["05", "activated", "rolled back to"]];
    const undone: Steps = [...newer, ["04", "retired", ""]];
    expect(before([told("a", again), told("b", undone)])).toBeNull();
    const out: Steps = [...first, ["02", "retired", "taken out of use: by mistake"]];
    expect(before([told("a", out), told("b", newer)])).toBeNull();
  });
});

it("reads the errors of the motion that was not fitted", () => {
  const errors = {
    joint1: { unit: "N m", noise_floor: 0.5, before: { train: 2, validate: 3 }, after: { train: 1, validate: 1.5 } },
    joint2: { unit: "N m", noise_floor: null, before: { train: 2, validate: null }, after: null },
  };
  expect(jointErrors(calibration({ errors }))).toEqual([
    { joint: "joint1", unit: "N m", before: 3, after: 1.5, noise: 0.5 },
    { joint: "joint2", unit: "N m", before: 2, after: null, noise: null },
  ]);
});
