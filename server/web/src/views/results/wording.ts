/** Names, units and changes of reports as a person reads them. */
import type { NoticeKind } from "../../ui/controls";
import { number } from "../../ui/format";
import type { Candidate, Law, Named, Report, Verdict } from "./report";
import { t } from "../../texts";
import { said } from "../../texts/report";

const SUPERSCRIPT: Record<string, string> = { "2": "²", "3": "³", "4": "⁴", "5": "⁵", "6": "⁶" };
// Measured and derived signals as programs write them; joints and files may be called anything else with underscores.
const SIGNAL =
  /(joint|piston|head|rod|supply|tank|cylinder|oil|base)_(position|speed|acceleration|effort|pressure|force|temperature|roll|pitch)/g;

/** A name in a text that may be the id of an effect. */
const NAME = /(?<![\w.])[a-z]+(?:_[a-z]+)+(?!\w)/g;

/** A unit with real exponents: `kg m^2` as `kg m²`; nothing for a number without one. */
export function unit(text: string | null | undefined): string {
  return (text === "1" ? "" : (text ?? ""))
    .replace("^(1/3)", "¹⁄³")
    .replace(" or ", t("results.or"))
    .replace(/\^([2-6])/g, (_all, power: string) => SUPERSCRIPT[power] ?? power);
}

/** `piston_position` as `piston position`. */
export function words(name: string): string {
  return name.replace(/_/g, " ");
}

/** A signal: `piston_position` as `piston position`, a neighbour's with the joint before it. */
export function signalWords(name: string): string {
  const at = name.lastIndexOf(".") + 1;
  return name.slice(0, at) + said(words(name.slice(at)));
}

/** Names of signals in a text with spaces; effects of the report by their titles. */
export function readable(text: string, report?: Report, joint: string | null = null): string {
  const { candidates = [], effects = [] } = report?.loop ?? {};
  const all = [...candidates, ...effects];
  // Joints that are driven otherwise call an effect otherwise: the last word is that of the joint in question.
  const named = [...all, ...all.filter((one) => joint !== null && one.joint === joint)];
  const titles = new Map(named.map((one) => [one.id, said(one.title ?? words(one.id))]));
  return said(text)
    .replace(NAME, (name) => titles.get(name) ?? name)
    .replace(SIGNAL, "$1 $2");
}

/** What an unexplained law says: `the error at joint1 follows the piston position`. */
export function follows(law: Law): string {
  const where = law.joint === null ? t("results.wholeMachine") : t("results.at", { joint: law.joint });
  const second = law.second_variable
    ? t("results.togetherWithThe", { secondVariable: signalWords(law.second_variable) })
    : "";
  let turns = law.times_sign_of_speed ? t("results.turnsItsSignWith") : "";
  if (law.only_while) turns = t(law.only_while === "positive" ? "results.onlyForward" : "results.onlyBackward");
  return t("results.errorFollows", { where, variable: signalWords(law.variable), second, turns });
}

export function capital(text: string): string {
  return text.slice(0, 1).toUpperCase() + text.slice(1);
}

/** The sizes of effects: a number with its unit. */
export function amount(value: number | null | undefined, units: string | null | undefined, digits = 3): string {
  return `${number(value, digits)} ${unit(units)}`.trim();
}

/** A parameter's name; those of effects are `effect_id:joint2.f_1` in files. */
export function parameterName(name: string): string {
  const match = /^([a-z0-9_]+):(.+)$/.exec(name);
  return match === null ? name : `${words(match[1] ?? "")}: ${match[2] ?? ""}`;
}

/** What an effect is called: its title, else that of the candidate of the same id (and joint), else its id in words. */
export function title(effect: Named, report: Report): string {
  const same = report.loop.candidates.filter((one) => one.id === effect.id && one.title);
  const here = same.find((one) => one.joint === effect.joint) ?? same[0];
  return said(effect.title ?? here?.title ?? words(effect.id));
}

export function place(joint: string | null): string {
  return joint ?? t("results.wholeMachine2");
}

export const VERDICTS: Record<Verdict, [NoticeKind, string]> = {
  nothing_missing: ["good", t("results.nothingIsMissing2")],
  effect_added: ["good", t("results.effectFoundAdded")],
  ambiguous: ["warning", t("results.somethingMissingSeveralCauses")],
  unexplained: ["warning", t("results.somethingMissingNoKnown")],
  implausible: ["bad", t("results.parameterPhysicallyImpossible")],
  check_input: ["bad", t("results.mistakeFilesWiringLikely")],
  not_examined: ["info", t("results.fittedOnlyWhatMissing")],
};

/** Of a verdict that may be newer than this page. */
export function verdictWords(verdict: string): [NoticeKind, string] {
  return VERDICTS[verdict as Verdict] ?? ["info", words(verdict)];
}

export const STATUSES: Record<Candidate["status"], [NoticeKind | "off", string]> = {
  accepted: ["good", t("results.accepted")],
  indistinguishable: ["warning", t("results.cannotToldApart")],
  artefact: ["info", t("results.artefactOfMeasurement")],
  rejected: ["off", t("common.rejected")],
};

export const PARAMETERS: Record<string, string> = {
  m: t("results.movingMass"),
  K: t("results.stiffness"),
  f_c: t("results.coulombFriction"),
  f_v: t("results.viscousFriction"),
  f_s: t("results.cubeRootFriction"),
  J: t("results.driveInertia"),
};
