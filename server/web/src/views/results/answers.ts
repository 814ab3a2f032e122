/** What the first screen of a result says, worked out from the report: values and words only. */
import { percent } from "../../ui/format";
import type { Effect, Hypothesis, Report } from "./report";
import { capital, follows, place, readable, title, words } from "./wording";

export interface Missing {
  words: string;
  /** 0 to 1; null in reports of earlier versions. */
  probability: number | null;
}
export interface Sure {
  best: Missing | null;
  second: Missing | null;
  /** How many times as probable the best is as the second; null if there is none beside it. */
  odds: number | null;
}

/** Every cause that was found, with its probability. */
export function missing(report: Report): Missing[] {
  const { effects, unexplained, hypotheses } = report.loop;
  return [
    ...effects.map((effect) => ({
      words: `${capital(title(effect, report))}, ${place(effect.joint)}`,
      probability: effect.probability ?? share(hypotheses, effect),
    })),
    ...unexplained.map((law) => ({ words: `Unexplained: ${follows(law)}`, probability: null })),
  ];
}

/** How much of the probability the explanations with this effect have together. */
function share(hypotheses: Hypothesis[], { id, joint }: Effect): number | null {
  if (hypotheses.length === 0) return null;
  const having = hypotheses.filter((one) =>
    one.effects.some((effect) => effect.id === id && (effect.joint ?? null) === joint),
  );
  return having.length === 0 ? null : having.reduce((sum, one) => sum + one.probability, 0);
}

export function hypothesisWords(hypothesis: Hypothesis, report: Report): string {
  const parts = [
    ...hypothesis.effects.map((effect) => `${title(effect, report)}, ${place(effect.joint)}`),
    ...hypothesis.laws.map(
      (law) => `a law of the ${words(law.variable)}, ${place(law.joint)}, that no known effect explains`,
    ),
  ];
  return parts.length === 0 ? "nothing is missing" : parts.join(" and ");
}

/** The most probable explanation and the next one. */
export function sure(report: Report): Sure {
  const ordered = [...report.loop.hypotheses].sort((a, b) => b.probability - a.probability);
  const [best, second] = ordered.map((one) => ({
    words: hypothesisWords(one, report),
    probability: one.probability,
  }));
  const odds = best && second && second.probability > 0 ? best.probability / second.probability : null;
  return { best: best ?? null, second: second ?? null, odds };
}

/** A probability as a person reads it: never 0 % or 100 % of what is not certain. */
export function chance(probability: number | null): string {
  if (probability === null) return "not worked out";
  if (probability > 0.9995) return "above 99.9 %";
  if (probability < 0.0005) return "below 0.1 %";
  return percent(probability, probability > 0.99 || probability < 0.01 ? 1 : 0);
}

/** `37 to 1`; what is beyond a thousand is said so. */
export function oddsWords(odds: number): string {
  return odds >= 1000 ? "more than 1000 to 1" : `${odds >= 10 ? Math.round(odds) : odds.toFixed(1)} to 1`;
}

const BY_VERDICT: Record<string, string[]> = {
  nothing_missing: ["Nothing has to be changed at the machine. Propose the result as a calibration."],
  unexplained: [
    "No known cause fits: look at the drawings below for what the error follows, and at that part of the machine.",
    "The law that was measured may be used; it holds for motions like these.",
  ],
  check_input: ["Look at files and wiring first: the warnings below name what is wrong. Then identify again."],
  implausible: ["A parameter cannot be: check masses, geometry and units in the machine file before this is used."],
  not_examined: ["Order an identification that looks for what is missing."],
};

/** What a person should do next, in the order of doing it. */
export function todo(report: Report): string[] {
  const { effects, verdict, next_experiment } = report.loop;
  const found = effects
    .filter((effect) => effect.look_at)
    .map((effect) => `Look at ${place(effect.joint)}: ${effect.look_at}.`);
  if (verdict === "effect_added") {
    if (found.length === 0) found.push("Look at the part that the cause names.");
    found.push("Until it is mended the model with the addition holds: propose it as a calibration.");
  }
  if (verdict === "ambiguous" && next_experiment !== null) {
    const motion = typeof next_experiment === "string" ? next_experiment : (next_experiment.motion ?? "");
    found.push(`To decide between them, record once more: ${readable(motion, report)}.`.replace("..", "."));
  }
  return [...found, ...(BY_VERDICT[verdict] ?? [])];
}
