/** What the result page shows, worked out from a report: values only, no drawing. */
import { language } from "../../texts/language";
import type { Candidate, ErrorPair, Limit, Report } from "./report";
import { PARAMETERS, readable, title } from "./wording";

/** A parameter that moved by more than so many standard deviations is pointed at. */
export const FLAG_SIGMAS = 3;

export interface JointRow {
  joint: string;
  unit: string;
  noise: number | null;
  before: number | null;
  after: number | null;
  /** Sizes after, which see a constant offset too; null in reports of earlier versions. */
  rms: number | null;
  mean: number | null;
  /** Error over measured effort, as a part of one. */
  relative: number | null;
  /** Whether more than half of the error's power is its mean. */
  offset: boolean;
  /** Percent of before; null where nothing was added or there is no validation motion. */
  change: number | null;
  /** Error after over noise floor: 1 is the noise itself. */
  overNoise: number | null;
  /** Whether something was added at this joint, or is blamed there. */
  named: boolean;
  /** Ends of the bars, as fractions of the longest bar of all joints; in noise floors, so that joints compare. */
  bar: { before: number; after: number; noise: number } | null;
}

/** Whether anything was added to the model: before and after differ only then. */
export function added(report: Report): boolean {
  return report.loop.effects.length > 0 || report.loop.unexplained.some((law) => law.added);
}

/** On which motion the errors are: the one that was not fitted, where there is one. */
export function judgedOn(report: Report): "validate" | "train" {
  const all = Object.values(report.errors);
  return all.some((errors) => errors.after.validate != null) ? "validate" : "train";
}

const ratio = (value: number | null | undefined, base: number | null): number | null =>
  value == null || base === null || !(base > 0) ? null : value / base;

function otherSizes(
  pair: ErrorPair,
  motion: "validate" | "train",
): Pick<JointRow, "rms" | "mean" | "relative" | "offset"> {
  const rms = pair[`${motion}_rms`] ?? null;
  const mean = pair[`${motion}_mean`] ?? null;
  const offset = rms !== null && mean !== null && mean ** 2 > 0.5 * rms ** 2;
  return { rms, mean, relative: pair[`${motion}_relative`] ?? null, offset };
}

/** Errors per joint before and after, on the motion that was not fitted. */
export function jointRows(report: Report): JointRow[] {
  const motion = judgedOn(report);
  const something = added(report);
  const blamed = new Set([...report.loop.effects, ...report.loop.unexplained].map((one) => one.joint));
  const rows = Object.entries(report.errors).map(([joint, errors]) => {
    const before = errors.before[motion] ?? null;
    const after = errors.after[motion] ?? null;
    const change = before === null || after === null || before === 0 ? null : (100 * (after - before)) / before;
    return {
      joint,
      unit: errors.unit,
      noise: errors.noise_floor,
      before: something ? before : null,
      after,
      ...otherSizes(errors.after, motion),
      change: something ? change : null,
      overNoise: ratio(after, errors.noise_floor),
      named: blamed.has(joint),
      ratios: [ratio(before, errors.noise_floor), ratio(after, errors.noise_floor)] as const,
    };
  });
  const longest = Math.max(1.25, ...rows.flatMap((row) => row.ratios.map((value) => value ?? 0)));
  return rows.map(({ ratios: [before, after], ...row }) => ({
    ...row,
    bar:
      before === null || after === null
        ? null
        : { before: before / longest, after: after / longest, noise: 1 / longest },
  }));
}

export interface Overall {
  change: number | null;
  interval: [number, number] | null;
  /** Root mean square over the joints of error over noise floor; null where a joint has neither. */
  overNoiseBefore: number | null;
  overNoise: number | null;
  /** Error over measured effort of all joints, as parts of one; null in reports of earlier versions. */
  relativeBefore: number | null;
  relative: number | null;
}

export function overall(report: Report): Overall {
  const motion = judgedOn(report);
  const mean = (which: "before" | "after"): number | null => {
    const squares: number[] = [];
    for (const errors of Object.values(report.errors)) {
      const value = ratio(errors[which][motion], errors.noise_floor);
      if (value !== null) squares.push(value * value);
    }
    return squares.length === 0 ? null : Math.sqrt(squares.reduce((sum, value) => sum + value, 0) / squares.length);
  };
  return {
    change: added(report) ? report.overall.change_percent : null,
    interval: added(report) ? report.overall.ci95_percent : null,
    overNoiseBefore: added(report) ? mean("before") : null,
    overNoise: mean("after"),
    relativeBefore: added(report) ? (report.overall.relative?.before ?? null) : null,
    relative: report.overall.relative?.after ?? null,
  };
}

export interface CandidateRow {
  title: string;
  joint: string | null;
  status: Candidate["status"];
  reason: string;
  score: number | null;
}

const ORDER: Candidate["status"][] = ["accepted", "indistinguishable", "artefact", "rejected"];

/** Candidates that matter, and those that do not; within each by status, then by score. */
export function candidates(report: Report): { kept: CandidateRow[]; refused: CandidateRow[] } {
  const rows = report.loop.candidates
    .map((one) => ({
      title: title(one, report),
      joint: one.joint,
      status: one.status,
      reason: readable(one.reason, report, one.joint),
      score: one.score,
    }))
    .sort(
      (a, b) => ORDER.indexOf(a.status) - ORDER.indexOf(b.status) || (b.score ?? -Infinity) - (a.score ?? -Infinity),
    );
  return {
    kept: rows.filter((row) => row.status !== "rejected"),
    refused: rows.filter((row) => row.status === "rejected"),
  };
}

export interface ShiftRow {
  name: string;
  meaning: string;
  unit: string;
  before: number | null;
  after: number | null;
  sigmas: number | null;
  far: boolean;
}

/** Parameters that the addition moved, the farthest first. */
export function shifts(report: Report): ShiftRow[] {
  const body = new Map(
    report.rigid_body.parameters.flatMap((one) => [
      [one.expression, one],
      [one.name ?? one.expression, one],
    ]),
  );
  return report.parameter_shifts
    .map((shift) => {
      const [joint = "", parameter = ""] = split(shift.name);
      const known = report.cylinders[joint]?.parameters[parameter];
      return {
        ...shift,
        meaning:
          known === undefined ? spelt(shift.name, body.get(shift.name)?.expression) : (PARAMETERS[parameter] ?? ""),
        unit: known?.unit ?? body.get(shift.name)?.unit ?? "",
        far: shift.sigmas !== null && Math.abs(shift.sigmas) > FLAG_SIGMAS,
      };
    })
    .sort((a, b) => Math.abs(b.sigmas ?? 0) - Math.abs(a.sigmas ?? 0));
}

/** The expression that a short name stands for; nothing where the name is the expression. */
function spelt(name: string, expression = ""): string {
  return expression === name ? "" : expression;
}

function split(name: string): [string, string] {
  const at = name.lastIndexOf(".");
  return at < 0 ? [name, ""] : [name.slice(0, at), name.slice(at + 1)];
}

export interface LimitGroup {
  title: string;
  limits: Limit[];
}

/** The smallest size at which each effect would have been seen, effect by effect. */
export function limitGroups(report: Report): LimitGroup[] {
  const groups = new Map<string, LimitGroup>();
  for (const limit of report.loop.detection_limits) {
    const group = groups.get(limit.id) ?? { title: title(limit, report), limits: [] };
    group.limits.push(limit);
    groups.set(limit.id, group);
  }
  return [...groups.values()].sort((a, b) => a.title.localeCompare(b.title, language));
}

/** Effects that nothing in these recordings can be said about: not even a large one would have been seen. */
export function unseen(report: Report): LimitGroup[] {
  return limitGroups(report)
    .map((group) => ({ ...group, limits: group.limits.filter((limit) => limit.smallest === null) }))
    .filter((group) => group.limits.length > 0);
}
