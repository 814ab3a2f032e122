/** The verdict in a few sentences, put together from the report: for languages that the service does not write. */
import { t } from "../../texts";
import { language } from "../../texts/language";
import { number, withStd } from "../../ui/format";
import { chance } from "./answers";
import { added, judgedOn, overall } from "./model";
import type { Effect, Report } from "./report";
import { capital, change, follows, place, title, unit, verdictWords } from "./wording";

/** Sizes of an effect that a sentence names, and units of what is a choice and no size. */
const SIZES = 4;
const NO_SIZES = ["choice", "index"];

/** The sentence that the service wrote, where it is in the language shown; else the same from the report's values. */
export function sentence(report: Report): string {
  if (language === "en" && report.summary !== null) return report.summary.sentence;
  const { verdict, effects, unexplained } = report.loop;
  const times = overall(report).overNoise;
  if (verdict === "nothing_missing") {
    const noise = times === null ? "" : t("results.sentence.noise", { times: number(times, 3) });
    return t("results.sentence.nothing", { noise });
  }
  const sets = effects.filter((one) => ambiguous(one) && !doubtful(one));
  const found = [...doubts(report), ...certain(report), ...sets.map((one) => either(one, report)), ...laws(report)];
  const gained = improvement(report);
  if (gained !== "" && found.length > 0) found.push(gained);
  if (verdict === "check_input") return [t("results.sentence.mistake"), ...found].join(" ");
  if (effects.length + unexplained.length === 0) return `${verdictWords(verdict)[1]}.`;
  return found.join(" ");
}

const ambiguous = (effect: Effect): boolean => effect.indistinguishable_from.length > 0;

/** Whether what is in no catalogue is more probable than an effect and its rivals together. */
function doubtful(effect: Effect): boolean {
  const rivals = effect.indistinguishable_from.map((one) =>
    typeof one === "string" ? 0 : ((one as { probability?: number | null }).probability ?? 0),
  );
  return effect.probability != null && rivals.reduce((sum, share) => sum + share, effect.probability) < 0.5;
}

function doubts(report: Report): string[] {
  return report.loop.effects
    .filter(doubtful)
    .map((effect) => t("results.sentence.doubtful", { title: title(effect, report), place: place(effect.joint) }));
}

function certain(report: Report): string[] {
  const named = report.loop.effects
    .filter((effect) => !ambiguous(effect) && !doubtful(effect))
    .map((effect) =>
      t("results.sentence.effect", { title: title(effect, report), place: place(effect.joint), sizes: sizes(effect) }),
    );
  return named.length === 0 ? [] : [t("results.sentence.lacked", { effects: named.join("; ") })];
}

function sizes(effect: Effect): string {
  const known = Object.entries(effect.parameters)
    .filter(([, one]) => one.value !== null && !NO_SIZES.includes(one.unit ?? ""))
    .slice(0, SIZES)
    .map(([name, one]) => `${name} = ${withStd(one.value, one.std)} ${unit(one.unit)}`.trim());
  return known.length === 0 ? "" : `; ${known.join(", ")}`;
}

function either(effect: Effect, report: Report): string {
  const rivals = effect.indistinguishable_from.map((one) => {
    if (typeof one === "string") return title({ id: one, joint: effect.joint }, report);
    const share = (one as { probability?: number | null }).probability ?? null;
    return title(one, report) + (share === null ? "" : ` (${chance(share)})`);
  });
  const own = effect.probability == null ? "" : ` (${chance(effect.probability)})`;
  const names = [title(effect, report) + own, ...rivals].join("; ");
  return t("results.sentence.cannotTell", { place: place(effect.joint), names });
}

function laws(report: Report): string[] {
  const lines = new Set(report.loop.unexplained.map((law) => capital(follows(law))));
  return [...lines].map((law) => t("results.sentence.law", { law }));
}

function improvement(report: Report): string {
  const { change: percent, interval } = overall(report);
  if (!added(report) || percent === null) return "";
  const motion = judgedOn(report) === "validate" ? t("results.sentence.onValidation") : t("results.sentence.onFitted");
  const range =
    interval === null
      ? ""
      : t("results.95IntervalTo", { interval: change(interval[0]), interval2: change(interval[1]) });
  return t("results.sentence.better", { change: change(percent), interval: range, motion });
}

/** The verdict in a few words. */
export function label(report: Report): string {
  const own = language === "en" ? report.summary?.label : undefined;
  return own ?? verdictWords(report.loop.verdict)[1];
}
