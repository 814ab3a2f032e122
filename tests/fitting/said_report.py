"""A report of every verdict that says all that reports can say, in texts of the program only."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from test_report import JOINTS, VERDICTS, sample_report

from fitting.effects import effects
from fitting.effects.base import Effect
from fitting.report import clean
from fitting.report.joint_words import _AS_WRITTEN, MOTOR, SLEW, JointWords
from fitting.report.languages import NAMES, content_of

#: Texts of reports, by groups.
TEXTS: dict[str, dict[str, str]] = content_of("de")["report"]
#: What a joint is driven by, and the words for it.
DRIVES = {"cylinder": _AS_WRITTEN, "motor": JointWords(**MOTOR, units={}), "slew": JointWords(**SLEW, units={})}
EVENTS = ("silent", "boot_up", "emergency", "bus_off", "bus_down", "utc_jump", "heartbeat_lost", "second_master")


def filled(group: str) -> list[str]:
    """Every sentence of a group of the report's texts, with values; what stands behind others stands behind one."""
    telling = [text for text in TEXTS[group] if len(text.replace("{}", "")) > 8]  # others are known within others
    whole = [text for text in telling if text[0] not in " ;"]
    behind = [whole[0] + text for text in telling if text[0] in " ;"]
    return [text.replace("'{}'", "'boom'").replace("{}", "1.25") for text in (*whole, *behind)]


def catalogue(words: JointWords) -> Iterator[tuple[Effect, dict[str, Any]]]:
    """Effects as a report has them."""
    for one in effects():
        said = {key: words.text(getattr(one, key)) for key in ("title", "look_at") if getattr(one, key)}
        yield one, {"id": one.id, "joint": None if one.machine_wide else "joint2", "equation": one.equation, **said}


def said_report(verdict: str, drive: str) -> dict[str, Any]:
    """The report of a verdict, of a machine that is driven so."""
    words = DRIVES[drive]
    report = sample_report(verdict if verdict in VERDICTS else "effect_added")
    report["loop"]["verdict"] = verdict
    known = list(catalogue(words))
    _search(report["loop"], known)
    _found(report["loop"], known, words)
    _explained(report["loop"], known, words)
    report["warnings"] = _warnings()
    report["checks"] = [
        {"severity": "mistake", "text": text, "cure": "swap the two channels in arm.yaml lines 39 and 43"}
        for text in filled("checks")
    ]
    report["plausibility"] = _impossible(words)
    _sizes(report)
    _estimates(report)
    if verdict != "nothing_missing":
        report["one_shot"]["comparison"] = _comparison()
    happened = [(what, text) for text, what in zip(filled("devices"), EVENTS * 9, strict=False)]
    report["data"][0]["events"] = [
        {"time": 12.34, "device": "can/node 31", "what": what, "text": text, "seconds": 0.4, "count": 1}
        for what, text in happened
    ] + [{"time": None, "device": "can", "what": "bus_off", "text": happened[0][1], "seconds": None, "count": 7}]
    return dict(clean(report))


def _search(loop: dict[str, Any], known: list[tuple[Effect, dict[str, Any]]]) -> None:
    reasons, outcomes = filled("reasons"), ("rejected", "accepted", "artefact")
    loop["candidates"] = [
        {**named, "score": 1.5, "status": outcomes[n % 3], "reason": reasons[n % len(reasons)]}
        for n, (_, named) in enumerate(known * 2)
    ]
    loop["detection_limits"] = [{**named, "smallest": 0.0123, "unit": "N m/rad"} for _, named in known]
    loop["reasons"] = filled("verdicts")[:3] if loop["verdict"] == "check_input" else []


def _found(loop: dict[str, Any], known: list[tuple[Effect, dict[str, Any]]], words: JointWords) -> None:
    curve = {f"f_{k}": {"value": 1.5, "std": 0.25, "unit": "N"} for k in (1, 2)}
    sizes = {
        "k1": {"value": 8123.4, "std": 96.2, "unit": "N/m"},
        **curve,
        "place: between piston and joint": {"value": 0.0, "unit": "choice"},
    }
    evidence: dict[str, Any] = dict.fromkeys(NAMES["evidence"], 0.5)
    evidence |= {"witness": filled("reasons")[0], "outside_band": True, "p": 1e-7}
    evidence["cutoffs"] = [{"hz": 2.1, "value": 0.0141, "std": 0.0001}]
    for effect in loop["effects"]:
        effect.update(known[-1][1], joint="joint2", parameters=sizes, evidence=evidence)
        worst = {"variable": words.signal("piston_position"), "at": 0.125, "unit": "m", "friction": "more"}
        effect["amplitude"] = {"largest": 12.5, "rms": 2.25, "unit": "N", "worst": worst}
        for number, rival in enumerate(effect["indistinguishable_from"]):
            rival.update({**known[number][1], "joint": "joint2"}, probability=0.25)
    for law in loop["unexplained"]:
        law.update(_law(words), could_be=[{**known[0][1], "probability": 0.25}], evidence=evidence, added=False)
        law["law"]["formula"] = {"kind": "threshold", "shape": 0.125, "rising": True, "share": 0.9}


def _law(words: JointWords) -> dict[str, Any]:
    return {"joint": "joint2", "variable": words.signal("piston_position"), "times_sign_of_speed": True}


def _explained(loop: dict[str, Any], known: list[tuple[Effect, dict[str, Any]]], words: JointWords) -> None:
    ids = [one.id for one, _ in known]
    other = _law(words) | {"variable": "joint3.piston_speed", "only_while": "negative"}
    hypotheses = [
        {"effects": [{"id": ids[0], "joint": "joint2"}], "laws": [], "probability": 0.625},
        {"effects": [], "laws": [_law(words), other], "probability": 0.25},
        {"effects": [], "laws": [], "probability": 0.001},
    ]
    steps = [
        {"before": hypotheses, "motion": {"text": text, "seconds": 60.5}, "after": hypotheses[1:]}
        for text in filled("motions")
    ]
    loop.update(hypotheses=hypotheses, resolution=steps)
    loop["next_experiment"] = {
        "motion": "; or ".join(words.text(one.experiment) for one, _ in known if one.experiment),
        "why": f"{ids[0]} and {ids[1]} differ by 2.5 standard deviations (4.2 % of the effect) in these recordings; "
        "closable by this motion: 7.5 standard deviations (31 % of the effect) with one recording, recordings "
        "needed: 2, chance of a single name: 99 %",
        "separates": [ids[0], "law of joint2.piston_speed"],
        "joint": "joint2",
    }


def _warnings() -> list[str]:
    return [
        *filled("warnings"),
        "friction was estimated with the arm attached on joint1, joint2: no unloaded recording of it",
        "this motion tells 5 of 9 parameters; assumed: joint1.m; poorly told: joint1.K; not told: ZZ2, MX2",
        "a.mf4: resampled from 99.5 Hz with uneven steps to 100 Hz with a zero-phase low pass, flat to 12.5 Hz; "
        "0.02 s beside gaps and at the ends are left out",
        "stage 1 with the arm attached is refused for joint1: no plausible arm fits these recordings, so the load may "
        "look like the drive; the values of the joint fit stand in its place",
        "joint2: validate moves where the training motions tell little: an error of 12.5 N m is to be expected there, "
        "2.5 N m on those motions; train on a motion that goes there",
        "the mass matrix is not positive definite at q = (0.5, 1.25), at joint2; the drive inertia of joint1 is below "
        "zero: efforts are predicted all the same, motions are not",
        "joint2: viscous friction changed 12.5 s into recording 2",
    ]


def _impossible(words: JointWords) -> dict[str, Any]:
    texts = (
        "the stiffness of joint1 is negative",
        "the friction of joint1 drives the motion at 0.000812 m/s instead of opposing it",
        "no links that can exist have ZZ1 = -1.25 kg m^2 together with the other base parameters",
    )
    number = {"value": -22.5, "std": 1.5, "unit": "N/m", "sigmas": 15.2, "possible": 0.5}
    violations = [
        {"joint": "joint1", "parameter": "K", "text": texts[n % 3], "cause": words.text(cause), **number}
        for n, cause in enumerate(NAMES["causes"].values())
    ]
    return {"violations": violations, "constrained": {"price_percent": {"train": 2.5, "validate": 0.75}}}


def _sizes(report: dict[str, Any]) -> None:
    """Errors with offsets, of the validation motion."""
    states = ("train_before", "before", "train_after", "after")
    sizes = {size: dict.fromkeys(states, 1.25) for size in ("rms", "mean", "relative")}
    sizes["relative"]["of"] = "joints"  # type: ignore[assignment]
    report["overall"].update(sizes, role="validate", unit="noise floors")
    report["errors"]["joint3"]["noise_floor_valid"] = False
    report["one_shot"]["relative"] = {"train": 0.0123, "validate": 0.0234}


def _estimates(report: dict[str, Any]) -> None:
    report["rigid_body"].update(
        estimator="possible",
        covariance="hac",
        price_percent={"train": 0.5, "validate": 1.5},
        details={"chi_square_price": 3.5, "standard_parameters": {"m1": 4.25}, "told_by_data": {"ZZ1": 0.85}},
    )
    said = filled("estimation")
    tried = [
        {"name": f"way{n}", "what": text, "training_error": 0.0123, "held_out_error": 0.0234}
        for n, text in enumerate(text for text in said if not text.endswith("."))
    ]
    why = " ".join(text for text in said if "rises" in text or text.startswith(("Rows", "All efforts")))
    report["estimation"] = {"chosen": "way1", "tried": tried, "why": why}


def _comparison() -> dict[str, Any]:
    """Two stages against one, in three sentences."""
    way = {"condition_number": 17.5, "overall": 1.25, "errors": dict.fromkeys(JOINTS, 2.5), "flagged": 3, "untold": 1}
    return {
        "role": "validate",
        "contenders": dict.fromkeys(NAMES["contenders"], way),
        "deviation_ratio": 0.45,
        "apart": [{"name": "joint2.f_c"}],
        "said": "The two stages are better conditioned than the one-shot regression (condition number 17.1 against "
        "282). Their error on the validation motion is the same within its uncertainty as that of the one-shot "
        "regression (-0.7 %, 95 % interval -5.5 to +2.2 %). With the unloaded recordings in the one-shot regression "
        "too, it is smaller than that one's (-8.9 %, 95 % interval -13.1 to -4.2 %): two-stage fitting is better here.",
    }
