/** `report.json` (schema `hilfit/report/1`) as far as the page shows it. */

export interface Value {
  value: number | null;
  std: number | null;
  unit: string | null;
}
/** Standard deviations; further sizes stand beside them, in reports of later versions. */
export interface ErrorPair {
  train: number | null;
  validate: number | null;
  train_rms?: number | null;
  train_mean?: number | null;
  train_relative?: number | null;
  validate_rms?: number | null;
  validate_mean?: number | null;
  validate_relative?: number | null;
}
export interface JointErrors {
  unit: string;
  noise_floor: number | null;
  before: ErrorPair;
  after: ErrorPair;
}
export interface Named {
  id: string;
  joint: string | null;
  title?: string | null;
}
export interface Effect extends Named {
  equation?: string | null;
  parameters: Record<string, Value>;
  /** Which part of the machine to look at. */
  look_at?: string;
  probability?: number | null;
  indistinguishable_from: (string | Named)[];
}
export interface Law {
  joint: string | null;
  variable: string;
  second_variable?: string | null;
  /** Whether the law turns its sign with the direction of motion. */
  times_sign_of_speed?: boolean;
  added: boolean;
}
/** One explanation of everything; neither effects nor laws: nothing is missing. */
export interface Hypothesis {
  effects: Named[];
  laws: Pick<Law, "joint" | "variable">[];
  probability: number;
}
export interface Candidate extends Named {
  score: number | null;
  status: "accepted" | "rejected" | "indistinguishable" | "artefact";
  reason: string;
}
export interface Limit extends Named {
  smallest: number | null;
  unit: string;
}
export interface NextExperiment {
  motion?: string | null;
  why?: string | null;
  separates?: string[];
  joint?: string | null;
  kind?: string | null;
  motion_file?: string | null;
  /** Whether the motion is made with the rods on the arm: `pinned`, or `unpinned`. */
  rods?: string | null;
  otherwise?: string[];
}
export interface Shift {
  name: string;
  before: number | null;
  after: number | null;
  sigmas: number | null;
}
export interface Scatter {
  joint: string;
  variable: string;
  unit: string;
  effort_unit: string;
  x: (number | null)[];
  before: (number | null)[];
  after: (number | null)[];
  /** What the law has to explain: it lies on the law. Null in reports of earlier versions. */
  partial?: (number | null)[] | null;
  direction: number[] | null;
  law_x: (number | null)[];
  law_y: (number | null)[];
  law_std: (number | null)[];
  law_back: (number | null)[] | null;
}
/** What is left of one joint: over time, over its own past and the speed, over frequency. */
export interface Diagnostics {
  joint: string;
  unit: string;
  fit_before: number | null;
  fit_after: number | null;
  bound: number | null;
  time: number[];
  measured: (number | null)[];
  before: (number | null)[];
  after: (number | null)[];
  lag: number[];
  auto: (number | null)[];
  cross_lag: number[];
  cross: (number | null)[];
  frequency: number[];
  density_before: (number | null)[];
  density_after: (number | null)[];
}
export interface FrictionCurve {
  joint: string;
  unit_x: string;
  unit_y: string;
  speed: (number | null)[];
  force: (number | null)[];
  std: (number | null)[];
  after: (number | null)[] | null;
}
const VERDICTS = [
  "check_input",
  "implausible",
  "not_examined",
  "nothing_missing",
  "effect_added",
  "ambiguous",
  "unexplained",
] as const;
export type Verdict = (typeof VERDICTS)[number];
export interface Report {
  machine: string;
  created: string;
  data: { role: string; file: string; sha256: string; samples: number }[];
  bandwidth_hz: number | null;
  noise_floor_method: string | null;
  reduction: { standard_parameters: number; base_parameters: number };
  cylinders: Record<string, { parameters: Record<string, Value> }>;
  rigid_body: {
    estimator: string;
    condition_number: number | null;
    parameters: ({ expression: string; name?: string } & Value)[];
  };
  errors: Record<string, JointErrors>;
  overall: {
    before: number | null;
    after: number | null;
    change_percent: number | null;
    ci95_percent: [number, number] | null;
    unit?: string | null;
    /** Norm of the errors over that of the measured efforts: of all joints stacked, or a mean over the joints. */
    relative?: { before: number | null; after: number | null; of: "stacked" | "joints" } | null;
  };
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
  summary: { label: string; sentence: string } | null;
  figures: { scatter: Scatter[]; friction: FrictionCurve[]; diagnostics: Diagnostics[] };
}

/**
 * A report as the service sent it; null if it is none that this page knows.
 *
 * Keys may have been added since, and reports of earlier versions lack some: what is not there is empty, never guessed.
 */
export function readReport(content: unknown): Report | null {
  if (typeof content !== "object" || content === null) return null;
  const given = content as Partial<Report> & { schema?: unknown };
  if (given.schema !== "hilfit/report/1" || given.errors === undefined || given.overall === undefined) return null;
  if (given.loop === undefined || !(VERDICTS as readonly string[]).includes(given.loop.verdict)) return null;
  const loop = given.loop as Partial<Report["loop"]> & { verdict: Verdict };
  return {
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
}
