"""A report of every verdict that says all that reports can say, in texts of the program only."""

from __future__ import annotations

from collections.abc import Iterator
from string import Formatter
from typing import Any

from test_report import JOINTS, VERDICTS, sample_report

from daq.messages import Sentence, messages_in, texts
from fitting.effects import effects
from fitting.effects.base import Effect
from fitting.report.joint_words import _AS_WRITTEN, MOTOR, SLEW, JointWords
from fitting.report.languages import NAMES
from fitting.report.schema.definition import clean

#: What a joint is driven by, and the words for it.
DRIVES = {"cylinder": _AS_WRITTEN, "motor": JointWords(**MOTOR), "slew": JointWords(**SLEW)}
EVENTS = ("silent", "boot_up", "emergency", "bus_off", "bus_down", "utc_jump", "heartbeat_lost", "second_master")


#: Values that are messages or words themselves.
WITHIN = {
    "first": Sentence("fitting.differ_these_recordings", rivals=["play", "stribeck"], now=1.25),
    "now": Sentence("fitting.standard_deviations_effect", standard_deviations=2.5, share=4.2),
    "why": Sentence("fitting.no_unloaded_recording"),
    "way": "slow",
    "late": "early",
    "better": "worse",
    "quantity": "joint position",
    "range": "stroke",
}


def said(code: str) -> Sentence:
    """A message of fitting with values: numbers where its text formats one, else names, messages or lists."""
    fields = [(name, spec) for _, name, spec, _ in Formatter().parse(texts("fitting", "en")["messages"][code]) if name]
    values = {name: 1.25 if spec and spec[-1] in "gf%" else WITHIN.get(name, "boom") for name, spec in fields}
    lists = {name: ["boom", "bucket"] for name, spec in fields if spec and spec[-1] not in "gf%"}
    return Sentence(f"fitting.{code}", **values | lists)


MOTIONS = ("staircase_constant_speeds_out", "swing_while_creeps_over", "rod_unpinned_free_strokes")
#: Every message of fitting.
ALL = [said(code) for code in texts("fitting", "en")["messages"]]
FINDINGS = [one for one in ALL if one.code.startswith("fitting.check_") and not one.code.endswith("_cure")]
REASONS = [one for one in ALL if one not in FINDINGS]


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
    report["warnings"] = REASONS
    where = Sentence("fitting.in_lines", file="arm.yaml", lines=["39", "43"])
    report["checks"] = [
        {"severity": "mistake", "text": text, "cure": said(f"{text.code.removeprefix('fitting.')}_cure") + where}
        for text in FINDINGS
    ]
    report["plausibility"] = _impossible(words)
    _sizes(report)
    _estimates(report)
    if verdict != "nothing_missing":
        report["one_shot"]["comparison"] = _comparison()
    event = Sentence("daq.no_heartbeat", place=Sentence("daq.bus_node", bus_name="can", node=31), now=1.25)
    report["data"][0]["events"] = [
        {"time": time, "device": "can/node 31", "what": what, "text": event, "seconds": 0.4, "count": 1}
        for time, what in zip((None, *[12.34] * len(EVENTS)), ("bus_off", *EVENTS), strict=True)
    ]
    return {**clean(report), "messages": messages_in(report)}


def _search(loop: dict[str, Any], known: list[tuple[Effect, dict[str, Any]]]) -> None:
    outcomes = ("rejected", "accepted", "artefact")
    loop["candidates"] = [
        {**named, "score": 1.5, "status": outcomes[n % 3], "reason": REASONS[n % len(REASONS)]}
        for n, (_, named) in enumerate(known * 2)
    ]
    loop["detection_limits"] = [{**named, "smallest": 0.0123, "unit": "N m/rad"} for _, named in known]
    loop["reasons"] = REASONS[:3] if loop["verdict"] == "check_input" else []


def _found(loop: dict[str, Any], known: list[tuple[Effect, dict[str, Any]]], words: JointWords) -> None:
    curve = {f"f_{k}": {"value": 1.5, "std": 0.25, "unit": "N"} for k in (1, 2)}
    sizes = {
        "k1": {"value": 8123.4, "std": 96.2, "unit": "N/m"},
        **curve,
        "place: between piston and joint": {"value": 0.0, "unit": "choice"},
    }
    evidence: dict[str, Any] = dict.fromkeys(NAMES["evidence"], 0.5)
    evidence |= {"witness": said("significant_neither"), "outside_band": True, "p": 1e-7}
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
        for text in map(said, MOTIONS)
    ]
    loop.update(hypotheses=hypotheses, resolution=steps)
    loop["next_experiment"] = {
        "motion": Sentence(
            "fitting.either_motion", motions=[words.text(one.experiment) for one, _ in known if one.experiment]
        ),
        "why": said("closable_by_motion"),
        "separates": [ids[0], "law of joint2.piston_speed"],
        "joint": "joint2",
    }


def _impossible(words: JointWords) -> dict[str, Any]:
    wrong = [said(code) for code in ("parameter_negative", "friction_drives", "no_links_can_exist")]
    number = {"value": -22.5, "std": 1.5, "unit": "N/m", "sigmas": 15.2, "possible": 0.5}
    violations = [
        {"joint": "joint1", "parameter": "K", "text": wrong[n % 3], "cause": words.text(cause), **number}
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
    tried = [
        {"name": f"way{n}", "what": what, "training_error": 0.0123, "held_out_error": 0.0234}
        for n, what in enumerate(NAMES["ways"].values())
    ]
    why = said("rows_weighted_measured_noise")
    report["estimation"] = {"chosen": "way1", "tried": tried, "why": why}


def _comparison() -> dict[str, Any]:
    """Two stages against one, in three sentences."""
    way = {"condition_number": 17.5, "overall": 1.25, "errors": dict.fromkeys(JOINTS, 2.5), "flagged": 3, "untold": 1}
    return {
        "role": "validate",
        "contenders": dict.fromkeys(NAMES["contenders"], way),
        "deviation_ratio": 0.45,
        "apart": [{"name": "joint2.f_c"}],
        "said": Sentence(
            "daq.sentences",
            sentences=[said(code) for code in ("two_stages_conditioned_shot", "no_error_compare")],
        ),
    }
