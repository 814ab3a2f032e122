"""Sentences of the report: the verdict, what was found, what to do next.

Sentences are made in English; each part goes through the ``language`` before values are put in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from daq.messages import Sentence
from fitting.report.languages import ENGLISH, NAMES, Language
from fitting.report.schema.definition import looked
from fitting.report.text import change, moved, number

#: Units of what states which variant of an effect it is, and not how large.
_NO_SIZES = ("choice", "index")
#: Measured and derived signals as programs write them; joints and files may be called anything else with underscores.
_SIGNALS = {
    f"{of}_{what}"
    for of in ("joint", "piston", "head", "rod", "supply", "tank", "cylinder", "oil", "base")
    for what in ("position", "speed", "acceleration", "effort", "pressure", "force", "temperature", "roll", "pitch")
}


def is_offset(mean: float | None, rms: float | None) -> bool:
    """Return whether most of an error's power is its mean: a constant offset, not a scatter."""
    return mean is not None and rms is not None and mean**2 > 0.5 * rms**2


def title(effect: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Return an effect's name for people."""
    return language.translated(str(effect["title"])) if effect.get("title") else language.words(str(effect["id"]))


def readable(text: str, titles: Mapping[str, str] | None = None, language: Language = ENGLISH) -> str:
    """Word a message of a report with names of signals in words, and effects as titles.

    ``joint2.piston_position`` becomes ``joint2 piston position``, and ``load_dependent_friction`` what ``titles`` (of
    effect ids, in this language) calls it; names that are neither are kept.
    """
    if not isinstance(text, Sentence):
        return language.translated(text)

    def named(value: str) -> str | None:
        if titles and value in titles:
            return language.quoted(language.lower(titles[value]))
        joint, _, signal = value.rpartition(".")
        return f"{joint} {language.words(signal)}".lstrip() if signal in _SIGNALS else None

    return text.worded(language.code, named)


def separated(item: str, titles: Mapping[str, str], language: Language = ENGLISH) -> str:
    """Word what an experiment separates, for a list: an effect's title, or a law's signal."""
    signal = item.removeprefix("law of ")
    if signal != item:
        return language.phrase("law of {}", language.words(signal))
    return language.lower(titles.get(item) or language.words(item))


def capital(text: str) -> str:
    """Capitalise a text's first letter, for the beginning of a line."""
    return text[:1].upper() + text[1:]


def evidence(entries: Mapping[str, Any], language: Language = ENGLISH) -> dict[str, Any]:
    """Return an effect's evidence, by names for people."""
    shown = {key: _cutoffs(entry, language) if key == "cutoffs" else entry for key, entry in entries.items()}
    return {
        language.phrase(NAMES["evidence"][key]) if key in NAMES["evidence"] else key: own for key, own in shown.items()
    }


def _cutoffs(entries: Sequence[Mapping[str, Any]], language: Language) -> list[str]:
    """Write ``0.0141 ± 0.0001 at 3.0 Hz`` each."""
    return [
        language.phrase("{} at {} Hz", language.with_std(e.get("value"), e.get("std")), language.number(e.get("hz"), 2))
        for e in entries
    ]


def _place(joint: str | None, language: Language = ENGLISH) -> str:
    """Write ``at joint2``, or the whole machine."""
    return language.phrase("at {}", joint) if joint else language.phrase("of the whole machine")


def _at(effect: Mapping[str, Any], language: Language = ENGLISH, sizes: str = "") -> str:
    """Write ``friction that depends on position at joint2 (k1 = 312 N/m)``."""
    named, where = language.lower(title(effect, language)), _place(effect.get("joint"), language)
    return language.phrase("{} {} ({})", named, where, sizes) if sizes else language.phrase("{} {}", named, where)


def alternatives(effect: Mapping[str, Any], titles: Mapping[str, str], language: Language = ENGLISH) -> list[str]:
    """List effects that these recordings cannot separate from ``effect``, for people, with place where it differs."""
    names = []
    for other in effect.get("indistinguishable_from") or []:
        entry = {"id": other, "joint": effect.get("joint")} if isinstance(other, str) else dict(other)
        entry["title"] = entry.get("title") or titles.get(str(entry["id"]))
        same = entry.get("joint") == effect.get("joint")
        names.append(language.lower(title(entry, language)) if same else _at(entry, language))
    return names


def sizes(parameters: Mapping[str, Any] | None, most: int = 4, language: Language = ENGLISH) -> str:
    """Write ``k1 = 312 ± 12 N/m``: the first few parameters of an effect."""
    parts = [
        f"{name} = {language.with_std(entry.get('value'), entry.get('std'))} {language.unit(entry.get('unit'))}".strip()
        for name, entry in list((parameters or {}).items())[:most]
        if entry.get("value") is not None and entry.get("unit") not in _NO_SIZES
    ]
    return language.phrase(", ").join(parts)


#: An effect with more sizes than that is a curve, and reported by what it does: nobody reads coefficients.
_READ = 2
#: What such an effect does, by whether it is friction and whether its place is a position.
_UP_TO = {
    (None, True): "up to {}, worst near {}",
    ("more", True): "up to {} more friction, worst near {}",
    ("less", True): "up to {} less friction, worst near {}",
    (None, False): "up to {}, worst where the {} is near {}",
    ("more", False): "up to {} more friction, worst where the {} is near {}",
    ("less", False): "up to {} less friction, worst where the {} is near {}",
}


def _how_large(effect: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Write a curve as ``up to 157 N more friction, worst near 120 mm``; one or two sizes with deviations."""
    parameters, size = effect.get("parameters") or {}, effect.get("amplitude")
    if not size or not size["largest"] or sum(entry.get("std") is not None for entry in parameters.values()) <= _READ:
        return sizes(parameters, language=language)
    most = f"{language.number(size['largest'])} {language.unit(size['unit'])}"
    if not size.get("worst"):
        return language.phrase("up to {}", most)
    worst = size["worst"]
    position = worst["variable"] in ("piston_position", "joint_position")
    named = [] if position else [language.words(worst["variable"])]
    pattern = _UP_TO[worst["friction"], position]
    return language.phrase(pattern, most, *named, language.size(worst["at"], worst["unit"]))


def validate(entry: Mapping[str, Any] | None) -> float | None:
    """Return the validation error of a ``{"train", "validate"}`` pair."""
    return (entry or {}).get("validate")


def over_noise(report: Mapping[str, Any], which: str) -> float | None:
    """Compute validation error over noise floor, RMS over the joints; None where a joint has neither."""
    squares = []
    for joint in report["errors"].values():
        error, floor = validate(joint.get(which)), joint.get("noise_floor")
        if error is not None and floor:
            squares.append((error / floor) ** 2)
    return math.sqrt(sum(squares) / len(squares)) if squares else None


def improvement(report: Mapping[str, Any], joints: Sequence[str | None], language: Language = ENGLISH) -> str:
    """Word the error's change on the validation motion: at one joint where one is concerned, and in all."""
    chosen = [joint for joint in dict.fromkeys(joints) if joint in report["errors"]]
    own = _improvement_at(report, chosen[0], language) if len(chosen) == 1 and chosen[0] is not None else ""
    overall = report["overall"]
    if not overall.get("change_percent"):
        return own
    where = "that of all joints together" if own else "the error of all joints on the validation motion"
    how = moved(overall["change_percent"])
    size = [language.percent(abs(overall["change_percent"])).removeprefix("+")] if "{}" in how else []
    ends = [language.percent(end) for end in overall.get("ci95_percent") or ()]
    interval = language.phrase(" (95\u202f% interval {} to {})", *ends) if ends else ""
    altogether = language.phrase(f"{where} {how}{{}}", *size, interval)
    return language.phrase("{} and {}", own, altogether) if own else altogether


def _improvement_at(report: Mapping[str, Any], joint: str, language: Language) -> str:
    """Word the change of one joint's error; nothing if none, or unknown."""
    entry = report["errors"][joint]
    before, after = validate(entry["before"]), validate(entry["after"])
    if before is None or after is None or before == after:
        return ""
    last, unit = language.number(after), language.unit(entry["unit"])
    error = "the error of {} on the validation motion"
    if number(before) == number(after):
        return language.phrase(f"{error} stayed at {{}} {{}}", joint, last, unit)
    percent = language.percent(change(before, after))
    way = "fell" if after < before else "rose"
    return language.phrase(
        f"{error} {way} from {{}} to {{}} {{}} ({{}})", joint, language.number(before), last, unit, percent
    )


def _signals(law: Mapping[str, Any], language: Language) -> str:
    """Word the signals of a law."""
    first, second = language.words(str(law["variable"])), law.get("second_variable")
    return language.phrase("{} together with the {}", first, language.words(str(second))) if second else first


def follows(law: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Word an unexplained law: ``the error at joint1 follows the piston position``."""
    way = law.get("only_while")
    own = language.phrase(", and turns its sign with the direction of motion") if law.get("times_sign_of_speed") else ""
    turns = language.phrase(f", only while the speed of the joint is {way}") if way else own
    where = _place(law.get("joint"), language)
    if (law.get("evidence") or {}).get("between"):
        pattern = "what the two position sensors {} disagree by follows the {}"
        return language.phrase(pattern, where, _signals(law, language))
    return language.phrase("the error {} follows the {}{}", where, _signals(law, language), turns)


#: Simple formulas, by what they are and whether they rise.
_FORMULAS = {
    ("power", None): "a power of the {} with the exponent {}",
    ("threshold", True): "a straight line above a threshold of {}",
    ("threshold", False): "a straight line below a threshold of {}",
    ("exponential", True): "an exponential that rises over {}",
    ("exponential", False): "an exponential that falls over {}",
    ("sine", None): "a sine with the wavelength {}",
    ("step", None): "a step at {}",
}


def nearest(law: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Word the simple formula nearest to a measured law; nothing where there is none."""
    formula = law["law"].get("formula")
    if formula is None:
        return ""
    shape = language.number(formula["shape"])
    place_ = f"{shape} {language.unit(law['unit'])}".rstrip() if law.get("unit") else shape
    kind = str(formula["kind"])
    if kind == "power":
        name = language.phrase(_FORMULAS[kind, None], language.words(str(law["variable"])), shape)
    else:
        way = bool(formula["rising"]) if kind in ("threshold", "exponential") else None
        name = language.phrase(_FORMULAS.get((kind, way), _FORMULAS["step", None]), place_)
    share = f"{100 * formula['share']:.0f}"
    return language.phrase("The nearest simple formula is {}; it explains {} % of the curve.", name, share)


def label(loop: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Word the verdict briefly, of the report's ``loop``."""
    left_open = None if loop["effects"] else NAMES["open"].get(loop.get("label") or "")
    return language.phrase(left_open or NAMES["verdicts"][_verdict(loop)])


def _verdict(loop: Mapping[str, Any]) -> str:
    """Return the verdict; where nothing was searched, reports of earlier versions state that nothing is missing."""
    verdict = str(loop["verdict"])
    return "not_examined" if verdict == "nothing_missing" and not looked(loop) else verdict


def verdict_sentence(report: Mapping[str, Any], titles: Mapping[str, str], language: Language = ENGLISH) -> str:
    """Word the verdict in a few sentences; every effect and law that was found is in it.

    ``titles`` by effect id are in this language, for effects that are only named.
    """
    loop = report["loop"]
    verdict = _verdict(loop)
    reasons = [language.translated(str(reason)) for reason in loop.get("reasons") or []]
    if verdict == "not_examined" or (verdict == "nothing_missing" and not reasons):
        return _nothing(verdict, over_noise(report, "after"), language)
    found = _found(report, titles, language)
    sentences = [f"{capital(reason)}." for reason in reasons]
    if verdict == "check_input":
        return " ".join([language.phrase("A mistake is more likely than any effect."), *sentences, *found])
    if verdict == "implausible":
        return " ".join([*_impossible(report, language), *found])
    if found:
        return " ".join([*found, *sentences])
    if reasons:
        return language.phrase("It cannot be said that nothing is missing: {}.", language.listed(reasons))
    return language.phrase("Structure is left in the error that no known effect explains.")


def _nothing(verdict: str, times: float | None, language: Language) -> str:
    """Word the result where nothing was found, or searched."""
    size = language.number(times)
    if verdict == "nothing_missing":
        noise = language.phrase(": on the validation motion the error is {} times that noise", size) if times else ""
        return language.phrase(
            "No joint shows anything above its measurement noise that the model does not explain{}.", noise
        )
    error = language.phrase(": on the validation motion the error is {} times the noise", size) if times else ""
    return language.phrase("The model was fitted, and nobody looked for what it may lack{}.", error)


def as_chance(probability: float, language: Language = ENGLISH) -> str:
    """Write a probability as far as trusted: ``84 %``, ``more than 99 %``, ``less than 1 %``."""
    rounded = math.floor(100 * probability + 0.5)
    if 1 <= rounded <= 99:
        return f"{rounded}\u202f%"
    return language.phrase("more than 99 %" if rounded > 99 else "less than 1 %")


def chance(probability: object, language: Language = ENGLISH) -> str:
    """Write a probability in brackets, `` (84 %)``; nothing if it is not known."""
    return f" ({as_chance(probability, language)})" if isinstance(probability, float) else ""


def explanation(hypothesis: Mapping[str, Any], titles: Mapping[str, str], language: Language = ENGLISH) -> str:
    """Word a hypothesis: its effects and laws with places, or that nothing is missing."""
    parts = [
        _at({**entry, "title": titles.get(str(entry["id"]))}, language) for entry in hypothesis.get("effects") or []
    ]
    laws = list(dict.fromkeys(follows(law, language) for law in hypothesis.get("laws") or []))
    if laws:
        pattern = "{}, as no known effect does" if len(laws) > 1 else "{} as no known effect does"
        parts.append(language.phrase(pattern, language.listed(laws)))
    return language.listed(parts) if parts else language.phrase("nothing is missing")


#: Explanations that a step of the resolution names, and the least probability of those after the first.
_LISTED, _WORTH_NAMING = 3, 0.02


def resolution(
    loop: Mapping[str, Any], titles: Mapping[str, str], language: Language = ENGLISH
) -> list[dict[str, str]]:
    """Word an ambiguity's resolution, of the report's ``loop``: per motion ``before``, ``motion`` and ``after``."""
    return [
        {
            "before": _explanations(step["before"], titles, language),
            "motion": f"{readable(step['motion']['text'], titles, language)}, "
            f"{language.number(step['motion']['seconds'], 2)} s",
            "after": _explanations(step["after"], titles, language),
        }
        for step in loop.get("resolution") or []
    ]


def _explanations(hypotheses: Sequence[Mapping[str, Any]], titles: Mapping[str, str], language: Language) -> str:
    """Write ``X at joint2 (53 %) or Y at joint2 (44 %)``."""
    named = [h for n, h in enumerate(hypotheses[:_LISTED]) if n == 0 or h["probability"] >= _WORTH_NAMING]
    texts = [explanation(h, titles, language) + chance(h["probability"], language) for h in named]
    return language.listed(texts, "or") or language.phrase("nothing is known")


#: Impossible parameters that a verdict names one by one.
_MOST_LISTED = 3


def _impossible(report: Mapping[str, Any], language: Language) -> list[str]:
    """Word what cannot be."""
    violations = (report.get("plausibility") or {}).get("violations") or []
    lines = [
        language.phrase("{}. Usual cause: {}.", capital(_violation(v, language)), language.translated(v["cause"]))
        for v in violations[:_MOST_LISTED]
    ]
    more = len(violations) - _MOST_LISTED
    return [*lines, *([language.phrase("{} more parameters are impossible too.", str(more))] if more > 0 else [])]


def _violation(violation: Mapping[str, Any], language: Language = ENGLISH) -> str:
    """Word a violation: ``the stiffness of joint1 is negative (-2260 +- 5 N/m)``."""
    value = language.with_std(violation.get("value"), violation.get("std"))
    size = f"{value} {language.unit(violation.get('unit'))}".strip()
    return f"{language.translated(violation['text'])} ({size})"


def _found(report: Mapping[str, Any], titles: Mapping[str, str], language: Language) -> list[str]:
    """Word the findings: certain effects, sets, laws, and what it is all worth."""
    loop = report["loop"]
    effects: Sequence[Mapping[str, Any]] = loop.get("effects") or []
    laws: Sequence[Mapping[str, Any]] = loop.get("unexplained") or []
    if not effects and not laws:
        return []
    certain = [e for e in effects if not e.get("indistinguishable_from")]
    sentences: list[str] = []
    if certain:
        named = [_at(e, language, _how_large(e, language)) for e in certain]
        sentences.append(language.phrase("the model lacked {}", language.listed(named)))
    sentences += [_one_of_a_set(e, titles, language) for e in effects if e.get("indistinguishable_from")]
    if laws:
        sentences.append(_unexplained(laws, titles, language))
    gain = improvement(report, [entry.get("joint") for entry in (*effects, *laws)], language)
    added = [*effects] + [law for law in laws if law.get("added", True)]
    if gain and added:
        sentences[-1] = language.phrase(f"{{}}; with {_added(effects, laws, len(added))}, {{}}", sentences[-1], gain)
    return [f"{capital(sentence)}." for sentence in sentences]


def _added(effects: Sequence[Mapping[str, Any]], laws: Sequence[Mapping[str, Any]], count: int) -> str:
    """Name what was added to the model briefly."""
    if any(e.get("indistinguishable_from") for e in effects):
        return "the first of them added" if len(effects) == 1 else "the first of each added"
    if laws and not effects:
        return "the measured law added as such" if len(laws) == 1 else "the measured laws added as such"
    return "it added" if count == 1 else "them added"


def _named(entry: Mapping[str, Any], titles: Mapping[str, str], language: Language) -> str:
    """Name an effect by its own title, or by its id's."""
    own = title(entry, language) if entry.get("title") else titles.get(str(entry["id"]))
    return language.lower(own or title(entry, language))


def _one_of_a_set(effect: Mapping[str, Any], titles: Mapping[str, str], language: Language) -> str:
    names = [language.lower(title(effect, language)), *alternatives(effect, titles, language)]
    chances = [e.get("probability") for e in (effect, *effect["indistinguishable_from"]) if isinstance(e, Mapping)]
    if len(chances) == len(names):
        names = [name + chance(p, language) for name, p in zip(names, chances, strict=True)]
    return language.phrase(
        "something is missing {}, and these recordings cannot tell whether it is {}",
        _place(effect.get("joint"), language),
        language.listed(names, "or"),
    )


def _unexplained(laws: Sequence[Mapping[str, Any]], titles: Mapping[str, str], language: Language) -> str:
    lines = language.listed(list(dict.fromkeys(follows(law, language) for law in laws)))
    perhaps = [
        _named(e, titles, language) + chance(e.get("probability"), language)
        for law in laws
        for e in law.get("could_be") or []
    ]
    what = "it" if len(laws) == 1 else "them"
    if not perhaps:
        return language.phrase(f"{{}}, and no known effect explains {what}", lines)
    pattern = f"{{}}, and no known effect explains {what} for certain; it may be {{}}"
    return language.phrase(pattern, lines, language.listed(perhaps, "or"))
