import { describe, expect, it } from "vitest";
import { change } from "../../ui/format";
import { added, candidates, jointRows, limitGroups, overall, shifts } from "./model";
import { type Report, readReport } from "./report";
import content from "./report.fixture.json";
import { follows, readable, title, unit } from "./wording";

const report = (): Report => readReport(structuredClone(content)) as Report;

describe("a report", () => {
  it("is read from what a demonstration wrote", () => {
    expect(report().loop.verdict).toBe("effect_added");
    expect(report().summary?.sentence).toContain("piston position at joint2");
    expect(added(report())).toBe(true);
  });

  it("of another schema is none", () => {
    for (const wrong of [null, 3, [], {}, { ...content, schema: "hilfit/report/2" }, { ...content, errors: undefined }])
      expect(readReport(wrong)).toBeNull();
    expect(readReport({ ...content, loop: { ...content.loop, verdict: "maybe" } })).toBeNull();
  });

  it("without what later versions added is shown as far as it goes", () => {
    const { schema, errors, overall: all } = content;
    const bare = readReport({ schema, errors, overall: all, loop: { verdict: "nothing_missing" } }) as Report;
    expect(bare.figures).toEqual({ scatter: [], friction: [], diagnostics: [] });
    expect(candidates(bare)).toEqual({ kept: [], refused: [] });
    expect(shifts(bare)).toEqual([]);
    expect(added(bare)).toBe(false);
  });
});

it("says that nobody looked where nobody did", () => {
  // What was found says nothing of it: who looked may have found nothing at all.
  const loop = { verdict: "nothing_missing", effects: [], candidates: [], detection_limits: [] };
  expect(readReport({ ...content, loop })?.loop.looked).toBe(true);
  expect(readReport({ ...content, loop: { ...loop, looked: false } })?.loop.looked).toBe(false);
});

describe("errors of joints", () => {
  it("compare in noise floors, on the motion that was not fitted", () => {
    const rows = jointRows(report());
    const [first, second] = rows as [(typeof rows)[0], (typeof rows)[0]];
    const errors = content.errors.joint2;
    expect(second.before).toBe(errors.before.validate);
    expect(second.change).toBeCloseTo(
      (100 * (errors.after.validate - errors.before.validate)) / errors.before.validate,
    );
    expect(second.overNoise).toBeCloseTo(errors.after.validate / errors.noise_floor);
    expect([first.named, second.named]).toEqual([false, true]);
    // The longest bar fills the drawing; one noise floor is as long for every joint.
    expect(second.bar?.before).toBeCloseTo(1);
    expect(first.bar?.noise).toBe(second.bar?.noise);
    expect(second.bar?.noise).toBeCloseTo(errors.noise_floor / errors.before.validate);
  });

  it("have no before where nothing was added", () => {
    const nothing = report();
    nothing.loop.effects = [];
    expect(jointRows(nothing).every((row) => row.before === null && row.change === null)).toBe(true);
    expect(overall(nothing)).toMatchObject({ change: null, interval: null, overNoiseBefore: null });
  });

  it("are of the fitted motion where there is no other, and have no bar without a noise floor", () => {
    const one = report();
    for (const errors of Object.values(one.errors)) {
      errors.before.validate = null;
      errors.after.validate = null;
    }
    expect(jointRows(one)[0]?.after).toBe(content.errors.joint1.after.train);
    for (const errors of Object.values(one.errors)) errors.noise_floor = null;
    expect(jointRows(one).every((row) => row.bar === null && row.overNoise === null)).toBe(true);
    expect(overall(one).overNoise).toBeNull();
  });

  it("have sizes that see an offset, and mark a mean that is most of the error", () => {
    const one = report();
    expect(jointRows(one)[1]).toMatchObject({ rms: 1.8886, mean: -0.35, offset: false });
    expect(jointRows(one)[1]?.relative).toBeCloseTo(1.8886 / 160);
    expect(overall(one)).toMatchObject({ relativeBefore: 0.0156, relative: 0.0064 });
    const after = one.errors.joint2?.after;
    if (after) Object.assign(after, { validate_rms: 3, validate_mean: -2.5 });
    expect(jointRows(one)[1]?.offset).toBe(true);
  });

  it("of reports of earlier versions have only the standard deviation", () => {
    const old = report();
    for (const errors of Object.values(old.errors)) errors.after = { train: 1, validate: 2 };
    delete old.overall.relative;
    expect(jointRows(old)[0]).toMatchObject({ after: 2, rms: null, mean: null, relative: null, offset: false });
    expect(overall(old).relative).toBeNull();
  });

  it("of all joints are a root mean square in noise floors", () => {
    const ratios = Object.values(content.errors).map((errors) => errors.after.validate / errors.noise_floor);
    const expected = Math.sqrt(ratios.reduce((sum, value) => sum + value ** 2, 0) / ratios.length);
    expect(overall(report()).overNoise).toBeCloseTo(expected);
  });
});

describe("what was tried, moved, and could not be seen", () => {
  it("puts what was accepted before what was rejected", () => {
    const { kept, refused } = candidates(report());
    expect(kept.map((row) => row.status)).toEqual(["accepted"]);
    expect(refused.length).toBe(content.loop.candidates.length - 1);
    const scores = refused.map((row) => row.score ?? -Infinity);
    expect([...scores].sort((a, b) => b - a)).toEqual(scores);
  });

  it("keeps what cannot be told apart, and artefacts, in view", () => {
    const other = report();
    other.loop.candidates = (["rejected", "artefact", "indistinguishable", "accepted"] as const).map((status) => ({
      id: status,
      joint: null,
      score: null,
      status,
      reason: "",
    }));
    expect(candidates(other).kept.map((row) => row.status)).toEqual(["accepted", "indistinguishable", "artefact"]);
  });

  it("shows the largest shift first, with its unit and meaning", () => {
    const rows = shifts(report());
    expect(rows[0]).toMatchObject({ name: "joint2.f_v", meaning: "viscous friction", unit: "N s/m", far: true });
    const sizes = rows.map((row) => Math.abs(row.sigmas ?? 0));
    expect([...sizes].sort((a, b) => b - a)).toEqual(sizes);
    expect(rows.filter((row) => row.far).every((row) => Math.abs(row.sigmas ?? 0) > 3)).toBe(true);
  });

  it("finds the unit of a shift by either name of its parameter, and says the name once", () => {
    const one = report();
    one.rigid_body.parameters = [
      { name: "MX1", expression: "MX1 + 0.9 m2", value: 1, std: 1, unit: "kg m" },
      { name: "MY1", expression: "MY1", value: 1, std: 1, unit: "kg m" },
    ];
    one.parameter_shifts = ["MX1", "MX1 + 0.9 m2", "MY1"].map((name) => ({ name, before: 0, after: 1, sigmas: 1 }));
    expect(shifts(one).map((row) => [row.unit, row.meaning])).toEqual([
      ["kg m", "MX1 + 0.9 m2"],
      ["kg m", ""],
      ["kg m", ""],
    ]);
  });

  it("groups detection limits by effect and loses none", () => {
    const groups = limitGroups(report());
    expect(groups.flatMap((group) => group.limits).length).toBe(content.loop.detection_limits.length);
    expect(new Set(groups.map((group) => group.title)).size).toBe(groups.length);
  });
});

describe("words", () => {
  it("are those of people", () => {
    expect(unit("kg m^2")).toBe("kg m²");
    expect([unit(null), unit("1"), unit("N (s/m)^(1/3)")]).toEqual(["", "", "N (s/m)¹⁄³"]);
    expect(readable("joint2: a structure in piston_position is left")).toContain("in piston position");
    expect(readable("within 31.5 of position_dependent_friction: see joint2.f_c", report())).toMatch(
      /^within 31.5 of friction that depends on the piston position: see joint2.f_c$/,
    );
    const law = { joint: "joint1", variable: "piston_position", added: true };
    expect(follows(law)).toBe("the error at joint1 follows the piston position");
    expect(follows({ ...law, times_sign_of_speed: true })).toMatch(
      /, and turns its sign with the direction of motion$/,
    );
    expect(follows({ ...law, only_while: "negative" })).toMatch(/, only while the speed of the joint is negative$/);
    expect([change(-65.2), change(5.34), change(0.01), change(null)]).toEqual([
      "−65\u202f%",
      "+5.3\u202f%",
      "0.0\u202f%",
      "–",
    ]);
    expect(title({ id: "position_dependent_friction", joint: null }, report())).toContain(
      "depends on the piston position",
    );
    expect(title({ id: "never_heard_of", joint: null }, report())).toBe("never heard of");
  });

  it("are those of the joint that a text is about", () => {
    const mixed = report();
    const id = "position_dependent_friction";
    mixed.loop.candidates = [
      { id, joint: "joint1", title: "friction over the piston", score: 1, status: "rejected", reason: `like ${id}` },
      { id, joint: "joint2", title: "friction over the joint", score: 1, status: "rejected", reason: `like ${id}` },
    ];
    mixed.loop.effects = [];
    expect(candidates(mixed).refused.map((row) => row.reason)).toEqual([
      "like friction over the piston",
      "like friction over the joint",
    ]);
    expect(title({ id, joint: "joint2" }, mixed)).toBe("friction over the joint");
  });
});
