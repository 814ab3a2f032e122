/** What the first screen of a result says, worked out from the report: values and words only. */
import { fixed, percent } from "../../ui/format";
import type { Effect, Hypothesis, Report } from "./report";
import { capital, follows, place, readable, signalWords, title } from "./wording";
import { t } from "../../texts";
import { said } from "../../texts/report";

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
    ...unexplained.map((law) => ({ words: t("results.unexplained", { law: follows(law) }), probability: null })),
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
    ...hypothesis.laws.map((law) =>
      t("results.lawNoKnownEffect", { variable: signalWords(law.variable), joint: place(law.joint) }),
    ),
  ];
  return parts.length === 0 ? t("results.nothingIsMissing") : parts.join(t("results.and"));
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

/** A probability as far as one can be trusted, as the report says it: never 0 % or 100 % of what is not certain. */
export function chance(probability: number | null): string {
  if (probability === null) return t("results.notWorkedOut");
  const rounded = Math.round(100 * probability);
  if (rounded > 99) return t("results.above", { share: percent(0.99) });
  return rounded < 1 ? t("results.below", { share: percent(0.01) }) : percent(probability);
}

/** `37 to 1`; what is beyond a thousand is said so. */
export function oddsWords(odds: number): string {
  return odds >= 1000 ? t("results.moreThan10001") : t("results.to1", { odds: fixed(odds, odds >= 10 ? 0 : 1) });
}

const BY_VERDICT: Record<string, string[]> = {
  nothing_missing: [t("results.nothingHasChangedAt")],
  unexplained: [t("results.noKnownCauseFits"), t("results.lawWasMeasuredMay")],
  check_input: [t("results.lookAtFilesWiring")],
  implausible: [t("results.parameterCannotCheckMasses")],
  not_examined: [t("results.orderIdentificationLooksWhat")],
};

/** What a person should do next, in the order of doing it. */
export function todo(report: Report): string[] {
  const { effects, verdict, next_experiment } = report.loop;
  const found = effects
    .filter((effect) => effect.look_at)
    .map((effect) => t("results.lookAt", { joint: place(effect.joint), lookAt: said(effect.look_at ?? "") }));
  if (verdict === "effect_added") {
    if (found.length === 0) found.push(t("results.lookAtPartCause"));
    found.push(t("results.untilMendedModelWith"));
  }
  if (verdict === "ambiguous" && next_experiment !== null) {
    const motion = typeof next_experiment === "string" ? next_experiment : (next_experiment.motion ?? "");
    found.push(t("results.decideBetweenThemRecord", { motion: readable(motion, report) }).replace("..", "."));
  }
  return [...found, ...(BY_VERDICT[verdict] ?? [])];
}
