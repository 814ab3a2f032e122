import { expect, it } from "vitest";
import { chance, missing, oddsWords, sure, todo } from "./answers";
import { cloud } from "./drawn";
import fixture from "./report.fixture.json";
import { readReport, type Report } from "./report";

const report = (change: (loop: Record<string, unknown>) => void): Report => {
  const copy = JSON.parse(JSON.stringify(fixture)) as { loop: Record<string, unknown> };
  change(copy.loop);
  return readReport(copy)!;
};
const friction = { id: "position_dependent_friction", joint: "joint2" };

it("says what was missing with its probability, over all explanations that have it", () => {
  const found = report((loop) => {
    loop.hypotheses = [
      { effects: [friction], laws: [], probability: 0.9 },
      { effects: [friction, { id: "payload", joint: null }], laws: [], probability: 0.06 },
      { effects: [], laws: [{ joint: "joint2", variable: "piston_position" }], probability: 0.04 },
    ];
  });
  expect(missing(found)).toEqual([
    { words: "Friction that depends on the piston position, joint2", probability: 0.9 + 0.06 },
  ]);
  const { best, second, odds } = sure(found);
  expect(best?.words).toBe("friction that depends on the piston position, joint2");
  expect(second?.words).toContain("whole machine");
  expect(odds).toBeCloseTo(15);
});

it("has no probability where the report has none, and is never certain", () => {
  expect(missing(report(() => undefined))[0]!.probability).toBeNull();
  expect(sure(report(() => undefined)).best).toBeNull();
  expect([chance(1), chance(0), chance(0.97), chance(0.995), chance(null)]).toEqual([
    "more than 99\u202f%",
    "less than 1\u202f%",
    "97\u202f%",
    "more than 99\u202f%",
    "not worked out",
  ]);
  expect([oddsWords(1.25), oddsWords(37.4), oddsWords(1e9)]).toEqual(["1.3 to 1", "37 to 1", "more than 1000 to 1"]);
});

it("says which part to look at when an effect was added, and what to record when several fit", () => {
  const added = report((loop) => {
    (loop.effects as Record<string, unknown>[])[0]!.look_at = "bore and rod of the cylinder";
  });
  expect(todo(added)[0]).toBe("Look at joint2: bore and rod of the cylinder.");
  const ambiguous = report((loop) => {
    loop.verdict = "ambiguous";
    loop.next_experiment = { motion: "the same stroke with two loads" };
  });
  expect(todo(ambiguous).join(" ")).toContain("record once more: the same stroke with two loads");
  for (const verdict of ["nothing_missing", "unexplained", "check_input", "implausible", "not_examined"])
    expect(todo(report((loop) => void (loop.verdict = verdict))).length).toBeGreaterThan(0);
});

it("draws what the law explains on the law, where the report has it", () => {
  const scatter = report(() => undefined).figures.scatter[0]!;
  const own = { ...scatter, partial: scatter.x.map(() => 7) };
  const drawn = cloud(own).before.series.filter((one) => one.kind === "points");
  expect(new Set(drawn.flatMap((one) => one.values.filter((value) => value !== null)))).toEqual(new Set([7]));
});
