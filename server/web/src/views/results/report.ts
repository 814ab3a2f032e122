/** `report.json` (schema `hilfit/report/1`) as far as the page shows it. */

import type { components } from "./report.gen";
import type { Message } from "../../texts/message";
import { inLanguage } from "../../texts/report";

type Schemas = components["schemas"];
/** With these keys there: {@link readReport} fills in what a report of an earlier version lacks. */
type With<T, K extends keyof T> = T & { [P in K]-?: Exclude<T[P], undefined> };

export type Value = With<Schemas["Value"], "value" | "std" | "unit">;
export type ErrorPair = With<Schemas["ErrorPair"], "train" | "validate">;
export type JointErrors = Omit<Schemas["JointErrors"], "before" | "after"> & { before: ErrorPair; after: ErrorPair };
export type Named = With<Schemas["Named"], "joint">;
export type Effect = With<Omit<Schemas["AddedEffect"], "parameters" | "indistinguishable_from">, "joint"> & {
  parameters: Record<string, Value>;
  indistinguishable_from: (string | Named)[];
};
export type Law = With<Omit<Schemas["Unexplained"], "law">, "added">;
export type Hypothesis = { effects: Named[]; laws: Schemas["LawPlace"][]; probability: number };
export type Candidate = With<Schemas["Candidate"], "joint" | "score" | "reason">;
export type Limit = With<Schemas["DetectionLimit"], "joint">;
export type NextExperiment = Schemas["NextExperiment"];
export type Shift = Schemas["Shift"];
export type Scatter = With<Schemas["ScatterFigure"], "direction" | "law_back">;
export type Diagnostics = Schemas["DiagnosticsFigure"];
export type FrictionCurve = With<Schemas["FrictionFigure"], "after">;
export type Verdict = Schemas["Loop"]["verdict"];

const VERDICTS: readonly Verdict[] = [
  "check_input",
  "implausible",
  "not_examined",
  "nothing_missing",
  "effect_added",
  "ambiguous",
  "unexplained",
];

/** What the page shows of a report. */
export interface Report {
  machine: string;
  created: string;
  data: Schemas["DataFile"][];
  bandwidth_hz: number | null;
  noise_floor_method: string | null;
  reduction: Schemas["Reduction"];
  cylinders: Record<string, { parameters: Record<string, Value> }>;
  rigid_body: Omit<Schemas["RigidBody"], "parameters"> & {
    parameters: ({ expression: string; name?: string | null } & Value)[];
  };
  errors: Record<string, JointErrors>;
  overall: Schemas["Overall"];
  loop: {
    verdict: Verdict;
    /** Whether anybody looked for what the model lacks: an identification can be ordered without that. */
    looked: boolean;
    effects: Effect[];
    unexplained: Law[];
    /** The most probable first; empty in reports of earlier versions. */
    hypotheses: Hypothesis[];
    candidates: Candidate[];
    detection_limits: Limit[];
    next_experiment: NextExperiment | string | null;
  };
  parameter_shifts: Shift[];
  warnings: string[];
  summary: Schemas["Summary"] | null;
  figures: { scatter: Scatter[]; friction: FrictionCurve[]; diagnostics: Diagnostics[] };
}

/**
 * A report as the service sent it; null if it is none that this page knows.
 *
 * Keys may have been added since, and reports of earlier versions lack some: what is not there is empty, never guessed.
 */
export function readReport(content: unknown): Report | null {
  if (typeof content !== "object" || content === null) return null;
  const given = content as Partial<Report> & { schema?: unknown; messages?: Record<string, Message> };
  if (given.schema !== "hilfit/report/1" || given.errors === undefined || given.overall === undefined) return null;
  if (given.loop === undefined || !(VERDICTS as readonly string[]).includes(given.loop.verdict)) return null;
  const loop = given.loop as Partial<Report["loop"]> & { verdict: Verdict };
  const report: Report = {
    machine: given.machine ?? "",
    created: given.created ?? "",
    data: given.data ?? [],
    bandwidth_hz: given.bandwidth_hz ?? null,
    noise_floor_method: given.noise_floor_method ?? null,
    reduction: given.reduction ?? { standard_parameters: 0, base_parameters: 0 },
    cylinders: given.cylinders ?? {},
    rigid_body: given.rigid_body ?? { estimator: "", condition_number: null, parameters: [] },
    errors: given.errors,
    overall: given.overall,
    loop: {
      verdict: loop.verdict,
      looked: loop.looked ?? true,
      effects: (loop.effects ?? []).map((effect) => ({
        ...effect,
        parameters: effect.parameters ?? {},
        indistinguishable_from: effect.indistinguishable_from ?? [],
      })),
      unexplained: (loop.unexplained ?? []).map((law) => ({ ...law, added: law.added ?? true })),
      hypotheses: loop.hypotheses ?? [],
      candidates: loop.candidates ?? [],
      detection_limits: loop.detection_limits ?? [],
      next_experiment: loop.next_experiment ?? null,
    },
    parameter_shifts: given.parameter_shifts ?? [],
    warnings: given.warnings ?? [],
    summary: given.summary ?? null,
    figures: {
      scatter: given.figures?.scatter ?? [],
      friction: given.figures?.friction ?? [],
      diagnostics: given.figures?.diagnostics ?? [],
    },
  };
  return inLanguage(report, given.messages);
}
