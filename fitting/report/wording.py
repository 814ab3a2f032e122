"""What the report says in sentences: the verdict, what was found, what to do next."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from fitting.report.schema import looked
from fitting.report.text import change, listed, moved, number, percent, unit, with_std, words

LABELS = {
    "nothing_missing": "Nothing is missing",
    "effect_added": "Effect found and added",
    "ambiguous": "Something is missing, several causes fit",
    "unexplained": "Something is missing, no known cause fits",
    "implausible": "A parameter is physically impossible",
    "check_input": "A mistake in files or wiring is likely",
    "not_examined": "Fitted only: what is missing was not looked for",
}

MEANINGS = {
    "m": "moving mass",
    "K": "stiffness",
    "f_c": "Coulomb friction",
    "f_v": "viscous friction",
    "f_s": "cube-root friction",
    "J": "drive inertia",
}

STATUSES = {
    "accepted": "accepted",
    "rejected": "rejected",
    "indistinguishable": "cannot be told apart",
    "artefact": "artefact of measurement",
}

ESTIMATORS = {
    "ols": "ordinary least squares (ols)",
    "wls": "weighted least squares (wls)",
    "gls": "generalised least squares (gls)",
    "joint_ols": "least squares of all efforts, both stages at once (joint_ols)",
    "robust": "robust least squares (robust)",
    "huber": "Huber's robust regression (huber)",
    "iv": "instrumental variables (iv)",
    "rls": "recursive least squares (rls)",
    "consistent": "weighted least squares of links that can exist (consistent)",
    "ridge": "weighted least squares drawn toward a prior (ridge)",
}

COVARIANCES = {
    "hac": "from the residual's own colour (heteroscedasticity and autocorrelation consistent)",
    "bootstrap": "from residuals drawn anew in blocks",
    "white": "as if residuals were white, which they are not: too small",
    "whitened": "from residuals whitened by the measured noise",
}

CONTENDERS = {
    "hierarchical": "two stages",
    "one_shot": "one-shot",
    "one_shot_with_unloaded": "one-shot, unloaded recordings too",
    "joint_refit": "joint refit (generalised least squares)",
}

EVIDENCE = {
    "score": "score: chi-square gained, less the price of its parameters",
    "gain": "chi-square gained",
    "held_out_gain": "gain on held-out blocks",
    "held_out_z": "that gain over its standard deviation",
    "validate_gain": "gain on the validation motion",
    "surviving": "share that survives projection on the rest of the model",
    "gap_before": "disagreement of the two position sensors before [m]",
    "gap_after": "disagreement of the two position sensors after [m]",
    "blocks_better": "blocks that became better",
    "witness": "unloaded recordings against loaded ones",
    "cutoffs": "fitted again with other filters",
    "replicas": "replicas of the recordings without it that were drawn",
    "inflation": "factor of chi-square by those replicas",
}

#: Units of what says which variant of an effect it is, and not how large.
_NO_SIZES = ("choice", "index")
#: A name in a text that may be the id of an effect.
_NAME = re.compile(r"(?<![A-Za-z0-9_.])[a-z]+(?:_[a-z]+)+(?![A-Za-z0-9_])")

# Measured and derived signals as programs write them; joints and files may be called anything else with underscores.
_SIGNAL = re.compile(
    r"(?<![A-Za-z0-9_])(?:joint|piston|head|rod|supply|tank|cylinder|oil|base)_"
    r"(?:position|speed|acceleration|effort|pressure|force|temperature|roll|pitch)(?![A-Za-z0-9_])"
)

NOISE_FLOOR = {
    "repeat": "measured: the same motion was recorded twice, and what differs between the two is noise "
    "(standard deviation of the difference of both residuals, over \u221a2)",
    "estimated": "estimated from the residuals alone, because no repeated motion was recorded; record one "
    "(role \u201crepeat\u201d) to have it measured",
}

#: How the relative error of all joints was made of those of single joints.
RELATIVE_OF = {
    "stacked": "the norm of all joints\u2019 errors over that of all joints\u2019 measured efforts",
    "joints": "the root mean square of the joints\u2019 relative errors, because N and N\u202fm do not add up",
}


def is_offset(mean: float | None, rms: float | None) -> bool:
    """Whether more than half of an error's power is its mean: a constant offset rather than a scatter."""
    return mean is not None and rms is not None and mean**2 > 0.5 * rms**2


def title(effect: Mapping[str, Any]) -> str:
    """Name of an effect for people."""
    return str(effect.get("title") or words(str(effect["id"])))


def lower(text: str) -> str:
    """Text with a small first letter, for the middle of a sentence; ``IDIM`` and ``K x`` stay."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text


def readable(text: str, titles: Mapping[str, str] | None = None) -> str:
    """Names of signals in a text with spaces, effects by their titles.

    ``joint2.piston_position`` becomes ``joint2 piston position``, and ``load_dependent_friction`` what ``titles`` (of
    effect ids) calls it; names that are neither stay.
    """
    if titles:
        text = _NAME.sub(lambda found: lower(titles.get(found[0], found[0])), text)
    return _SIGNAL.sub(lambda found: words(found[0]), re.sub(rf"(?<=\w)\.(?={_SIGNAL.pattern})", " ", text))


def capital(text: str) -> str:
    """Text with a large first letter, for the beginning of a line."""
    return text[:1].upper() + text[1:]


def evidence(entries: Mapping[str, Any]) -> dict[str, Any]:
    """What speaks for an effect, by names for people."""
    return {EVIDENCE.get(key, key): _cutoffs(entry) if key == "cutoffs" else entry for key, entry in entries.items()}


def _cutoffs(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """``0.0141 \u00b1 0.0001 at 3.0 Hz`` each."""
    return [f"{with_std(e.get('value'), e.get('std'))} at {number(e.get('hz'), 2)} Hz" for e in entries]


def place(joint: str | None) -> str:
    """``at joint2``, or the whole machine."""
    return f"at {joint}" if joint else "of the whole machine"


def at(effect: Mapping[str, Any]) -> str:
    """``friction that depends on position at joint2``."""
    return f"{lower(title(effect))} {place(effect.get('joint'))}"


def alternatives(effect: Mapping[str, Any], titles: Mapping[str, str]) -> list[str]:
    """Effects that these recordings cannot tell from ``effect``, as people name them, with place where it differs."""
    names = []
    for other in effect.get("indistinguishable_from") or []:
        entry = {"id": other, "joint": effect.get("joint")} if isinstance(other, str) else dict(other)
        entry["title"] = entry.get("title") or titles.get(str(entry["id"]))
        same = entry.get("joint") == effect.get("joint")
        names.append(lower(title(entry)) if same else at(entry))
    return names


def sizes(parameters: Mapping[str, Any] | None, most: int = 4) -> str:
    """``k1 = 312 \u00b1 12 N/m``: the first few parameters of an effect."""
    parts = [
        f"{name} = {with_std(entry.get('value'), entry.get('std'))} {unit(entry.get('unit'))}".strip()
        for name, entry in list((parameters or {}).items())[:most]
        if entry.get("value") is not None and entry.get("unit") not in _NO_SIZES
    ]
    return ", ".join(parts)


def validate(entry: Mapping[str, Any] | None) -> float | None:
    """The validation error of a ``{"train", "validate"}`` pair."""
    return (entry or {}).get("validate")


def over_noise(report: Mapping[str, Any], which: str) -> float | None:
    """Validation error over noise floor, root mean square over the joints; None where a joint has neither."""
    squares = []
    for joint in report["errors"].values():
        error, floor = validate(joint.get(which)), joint.get("noise_floor")
        if error is not None and floor:
            squares.append((error / floor) ** 2)
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def interval(ci: Sequence[float] | None) -> str:
    """``(95 % interval \u221266 % to \u221252 %)`` or nothing."""
    return f" (95\u202f% interval {percent(ci[0])} to {percent(ci[1])})" if ci else ""


def improvement(report: Mapping[str, Any], joints: Sequence[str | None]) -> str:
    """How the error changed on the validation motion: at one joint where one is concerned, and altogether."""
    parts = []
    chosen = [joint for joint in dict.fromkeys(joints) if joint in report["errors"]]
    if len(chosen) == 1 and chosen[0] is not None:
        entry = report["errors"][chosen[0]]
        before, after = validate(entry["before"]), validate(entry["after"])
        if before is not None and after is not None and before != after:
            error = f"the error of {chosen[0]} on the validation motion"
            if number(before) == number(after):
                parts.append(f"{error} stayed at {number(after)} {unit(entry['unit'])}")
            else:
                parts.append(
                    f"{error} {'fell' if after < before else 'rose'} from {number(before)} to {number(after)} "
                    f"{unit(entry['unit'])} ({percent(change(before, after))})"
                )
    overall = report["overall"]
    if overall.get("change_percent"):
        where = "that of all joints together" if parts else "the error of all joints on the validation motion"
        parts.append(f"{where} {moved(overall['change_percent'])}{interval(overall.get('ci95_percent'))}")
    return " and ".join(parts)


def _signals(law: Mapping[str, Any]) -> str:
    """What a law is a law of, in words."""
    second = law.get("second_variable")
    return words(str(law["variable"])) + (f" together with the {words(str(second))}" if second else "")


def follows(law: Mapping[str, Any]) -> str:
    """``the error at joint1 follows the piston position``: what an unexplained law says."""
    way = law.get("only_while")
    turns = ", and turns its sign with the direction of motion" if law.get("times_sign_of_speed") else ""
    turns = f", only while the speed of the joint is {way}" if way else turns
    return f"the error {place(law.get('joint'))} follows the {_signals(law)}{turns}"


def nearest(law: Mapping[str, Any]) -> str:
    """The simple formula that comes nearest to a measured law, in a sentence; nothing where there is none."""
    formula = law["law"].get("formula")
    if formula is None:
        return ""
    signal, shape = words(str(law["variable"])), number(formula["shape"])
    place_ = f"{shape} {unit(law['unit'])}".rstrip() if law.get("unit") else shape
    kind = str(formula["kind"])
    if kind == "power":
        said = f"a power of the {signal} with the exponent {shape}"
    elif kind == "threshold":
        said = f"a straight line {'above' if formula['rising'] else 'below'} a threshold of {place_}"
    elif kind == "exponential":
        said = f"an exponential that {'rises' if formula['rising'] else 'falls'} over {place_}"
    elif kind == "sine":
        said = f"a sine with the wavelength {place_}"
    else:
        said = f"a step at {place_}"
    return f"The nearest simple formula is {said}; it explains {100 * formula['share']:.0f} % of the curve."


def label(loop: Mapping[str, Any]) -> str:
    """The verdict in a few words, of the report's ``loop``."""
    return LABELS[loop["verdict"] if looked(loop) else _unlooked(loop)]


def _unlooked(loop: Mapping[str, Any]) -> str:
    """The verdict where nobody looked for what is missing; reports of earlier versions called it nothing."""
    verdict = str(loop["verdict"])
    return "not_examined" if verdict == "nothing_missing" else verdict


def verdict_sentence(report: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """The verdict in a few sentences; every effect and law that was found is in it.

    Parameters
    ----------
    report : a checked report
    titles : effect id to title, for effects that are only named
    """
    loop = report["loop"]
    verdict = loop["verdict"] if looked(loop) else _unlooked(loop)
    reasons = [str(reason) for reason in loop.get("reasons") or []]
    times = over_noise(report, "after")
    if verdict == "nothing_missing":
        noise = f": on the validation motion the error is {number(times)} times that noise" if times else ""
        return f"No joint shows anything above its measurement noise that the model does not explain{noise}."
    if verdict == "not_examined":
        error = f": on the validation motion the error is {number(times)} times the noise" if times else ""
        return f"The model was fitted, and nobody looked for what it may lack{error}."
    found = _found(report, titles)
    if verdict == "check_input":
        return " ".join(["A mistake is more likely than any effect.", *(f"{capital(r)}." for r in reasons), *found])
    if verdict == "implausible":
        violations = (report.get("plausibility") or {}).get("violations") or []
        said = [f"{capital(impossible(v))}. Usual cause: {v['cause']}." for v in violations[:_MOST_SAID]]
        more = len(violations) - _MOST_SAID
        rest = [f"{more} more parameters are impossible too."] if more > 0 else []
        return " ".join([*said, *rest, *found])
    if found:
        return " ".join([*found, *(f"{capital(r)}." for r in reasons)])
    because = f": {listed(reasons)}" if reasons else " that no known effect explains"
    return f"{'It cannot be said that nothing is missing' if reasons else 'Structure is left in the error'}{because}."


def as_chance(probability: float) -> str:
    """A probability as far as one can be trusted: ``84 %``, ``more than 99 %``, ``less than 1 %``."""
    rounded = round(100 * probability)
    return "more than 99 %" if rounded > 99 else "less than 1 %" if rounded < 1 else f"{rounded} %"


def chance(probability: object) -> str:
    """A probability in brackets, `` (84 %)``; nothing if it is not known."""
    return f" ({as_chance(probability)})" if isinstance(probability, float) else ""


def doubtful(entry: Mapping[str, Any]) -> bool:
    """Whether what is in no catalogue is more probable than an effect of the report and its rivals together."""
    rivals = [r.get("probability") for r in entry.get("indistinguishable_from") or [] if isinstance(r, Mapping)]
    own = entry.get("probability")
    return isinstance(own, float) and own + sum(p for p in rivals if isinstance(p, float)) < 0.5


def explanation(hypothesis: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """A hypothesis in words: its effects and laws with their places, or that nothing is missing."""
    parts = [at({**entry, "title": titles.get(str(entry["id"]))}) for entry in hypothesis.get("effects") or []]
    laws = list(dict.fromkeys(follows(law) for law in hypothesis.get("laws") or []))
    if laws:
        parts.append(f"{listed(laws)}{',' if len(laws) > 1 else ''} as no known effect does")
    return listed(parts) if parts else "nothing is missing"


#: Explanations that a step of the resolution names, and the least probability of those after the first.
_LISTED, _WORTH_NAMING = 3, 0.02


def resolution(loop: Mapping[str, Any], titles: Mapping[str, str]) -> list[dict[str, str]]:
    """What was done about an ambiguity, of the report's ``loop``: per motion ``before``, ``motion`` and ``after``."""
    return [
        {
            "before": _explanations(step["before"], titles),
            "motion": f"{step['motion']['text']}, {number(step['motion']['seconds'], 2)} s",
            "after": _explanations(step["after"], titles),
        }
        for step in loop.get("resolution") or []
    ]


def _explanations(hypotheses: Sequence[Mapping[str, Any]], titles: Mapping[str, str]) -> str:
    """``X at joint2 (53 %) or Y at joint2 (44 %)``."""
    named = [h for n, h in enumerate(hypotheses[:_LISTED]) if n == 0 or h["probability"] >= _WORTH_NAMING]
    return listed([explanation(h, titles) + chance(h["probability"]) for h in named], "or") or "nothing is known"


#: Impossible parameters that a verdict names one by one.
_MOST_SAID = 3


def impossible(violation: Mapping[str, Any]) -> str:
    """A violation with its numbers: ``the stiffness of joint1 is negative (-2260 +- 5 N/m)``."""
    size = f"{with_std(violation.get('value'), violation.get('std'))} {unit(violation.get('unit'))}".strip()
    return f"{violation['text']} ({size})"


def _found(report: Mapping[str, Any], titles: Mapping[str, str]) -> list[str]:
    """What was found, in sentences: effects that are certain, sets, laws, and what it is all worth."""
    loop = report["loop"]
    effects: Sequence[Mapping[str, Any]] = loop.get("effects") or []
    laws: Sequence[Mapping[str, Any]] = loop.get("unexplained") or []
    if not effects and not laws:
        return []
    gain = improvement(report, [entry.get("joint") for entry in (*effects, *laws)])
    certain = [e for e in effects if not e.get("indistinguishable_from") and not doubtful(e)]
    sentences = [
        f"{lower(title({**e, 'title': e.get('title') or titles.get(str(e['id']))}))} takes a part of what is missing "
        f"{place(e.get('joint'))}, but something that is in no catalogue is more probable"
        for e in effects
        if doubtful(e)
    ]
    if certain:
        named = [at(e) + (f" ({sizes(e.get('parameters'))})" if sizes(e.get("parameters")) else "") for e in certain]
        sentences.append(f"the model lacked {listed(named)}")
    for entry in effects:
        if entry.get("indistinguishable_from") and not doubtful(entry):
            names = [lower(title(entry)), *alternatives(entry, titles)]
            chances = [
                e.get("probability") for e in (entry, *entry["indistinguishable_from"]) if isinstance(e, Mapping)
            ]
            if len(chances) == len(names):
                names = [name + chance(p) for name, p in zip(names, chances, strict=True)]
            sentences.append(
                f"something is missing {place(entry.get('joint'))}, and these recordings cannot tell whether it is "
                f"{listed(names, 'or')}"
            )
    if laws:
        lines = listed(list(dict.fromkeys(follows(law) for law in laws)))
        what = "it" if len(laws) == 1 else "them"
        perhaps = [
            lower(title({**e, "title": e.get("title") or titles.get(str(e["id"]))})) + chance(e.get("probability"))
            for law in laws
            for e in law.get("could_be") or []
        ]
        certain_or_not = f" for certain; it may be {listed(perhaps, 'or')}" if perhaps else ""
        sentences.append(f"{lines}, and no known effect explains {what}{certain_or_not}")
    if gain:
        added = [*effects] + [law for law in laws if law.get("added", True)]
        with_it = "it added" if len(added) == 1 else "them added"
        if any(e.get("indistinguishable_from") and not doubtful(e) for e in effects):
            with_it = "the first of them added" if len(effects) == 1 else "the first of each added"
        elif laws and not effects:
            with_it = "the measured law added as such" if len(laws) == 1 else "the measured laws added as such"
        if added:
            sentences[-1] += f"; with {with_it}, {gain}"
    return [f"{capital(sentence)}." for sentence in sentences]
