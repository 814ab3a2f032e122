"""What counts as right, in the set, wrong: by example."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.attribution.judging import Findings
from benchmarks.attribution.making import TrueEffect
from benchmarks.attribution.verdicts import verdict

STRIBECK = TrueEffect("stribeck", "joint2", 50.0, 12.0, "joint2")
TILT = TrueEffect("base_tilt", None, 0.02, 12.0, None)
GUIDE = TrueEffect("bent_guide", "joint1", 50.0, 12.0, "joint1", ("piston_position",))


def found(*sets: str, laws: tuple[tuple[str, str | None], ...] = ()) -> Findings:
    """``"stribeck@joint2|quadratic_loss@joint2"`` is a set of two; no joint after ``@``: the machine."""
    places = [[member.partition("@") for member in text.split("|")] for text in sets]
    return Findings(tuple(tuple((e, j or None) for e, _, j in members) for members in places), laws, {})


@pytest.mark.parametrize(
    ("kind", "effects", "what", "result"),
    [
        ("null", (), found(), "right"),
        ("null", (), found("stribeck@joint1"), "accused"),
        ("null", (), found(laws=(("time", "joint1"),)), "accused"),
        ("large", (STRIBECK,), found("stribeck@joint2"), "right"),
        ("large", (STRIBECK,), found("stribeck@joint2|quadratic_loss@joint2"), "in set"),
        ("large", (STRIBECK,), found("quadratic_loss@joint2|stribeck@joint2"), "in set"),
        ("large", (STRIBECK,), found("stribeck@joint3"), "wrong"),
        ("large", (STRIBECK,), found("quadratic_loss@joint2|gas_spring@joint2"), "wrong set"),
        ("large", (STRIBECK,), found(laws=(("piston_speed", "joint2"),)), "unexplained"),
        ("large", (STRIBECK,), found(), "silent"),
        ("large", (TILT,), found("base_tilt@"), "right"),
        ("large", (TILT,), found("base_tilt@joint1"), "wrong"),
        ("outside", (GUIDE,), found(laws=(("piston_position", "joint1"),)), "right"),
        ("outside", (GUIDE,), found(laws=(("piston_speed", "joint1"),)), "elsewhere"),
        ("outside", (GUIDE,), found(laws=(("piston_position", "joint2"),)), "elsewhere"),
        ("outside", (GUIDE,), found("position_harmonic@joint1"), "wrong"),
        ("outside", (GUIDE,), found("position_harmonic@joint1", laws=(("piston_position", "joint1"),)), "wrong"),
        ("outside", (GUIDE,), found(), "silent"),
        ("pairs", (STRIBECK, TILT), found("stribeck@joint2", "base_tilt@"), "right"),
        ("pairs", (STRIBECK, TILT), found("stribeck@joint2", "base_tilt@|payload@"), "in set"),
        ("pairs", (STRIBECK, TILT), found("stribeck@joint2"), "partly"),
        ("pairs", (STRIBECK, TILT), found(), "silent"),
    ],
)
def test_a_verdict_is_right_wrong_or_silent_as_the_case_says(
    kind: str, effects: tuple[TrueEffect, ...], what: Findings, result: str
) -> None:
    assert verdict(kind, effects, what).result == result


def test_a_second_finding_beside_the_right_one_is_surplus() -> None:
    alone = verdict("large", (STRIBECK,), found("stribeck@joint2", "gas_spring@joint4"))
    assert (alone.result, alone.surplus, alone.wrong_alone) == ("right", 1, (("gas_spring", "joint4"),))
    with_law = verdict("large", (STRIBECK,), found("stribeck@joint2", laws=(("time", "joint2"),)))
    assert (with_law.result, with_law.surplus, with_law.wrong_alone) == ("right", 1, ())


def test_a_set_without_the_truth_is_no_wrong_name_alone() -> None:
    outcome = verdict("large", (STRIBECK,), found("quadratic_loss@joint2|gas_spring@joint2"))
    assert outcome.wrong_alone == () and outcome.widest == 2


def test_one_effect_named_twice_is_surplus() -> None:
    assert verdict("large", (STRIBECK,), found("stribeck@joint2", "stribeck@joint2|gas_spring@joint2")).surplus == 1


def test_a_law_said_with_the_right_name_beside_it_is_a_set_with_an_unknown_effect() -> None:
    law = ("piston_speed", "joint2")
    place = ((*law, 0.6), ("stribeck", "joint2", 0.3))
    what = replace(found(laws=(law,)), stated=(place,))
    assert (verdict("large", (STRIBECK,), what).result, verdict("large", (STRIBECK,), what).surplus) == ("in set", 0)
    other = replace(what, stated=((place[0], ("gas_spring", "joint2", 0.3)),))
    assert verdict("large", (STRIBECK,), other).result == "unexplained"
    beside_another = replace(what, stated=(place, (("time", "joint3", 0.9),)), laws=(law, ("time", "joint3")))
    assert verdict("large", (STRIBECK,), beside_another).surplus == 1


def test_a_law_at_the_right_joint_locates_the_effect() -> None:
    assert verdict("large", (STRIBECK,), found(laws=(("time", "joint2"),))).located
    assert not verdict("large", (STRIBECK,), found(laws=(("time", "joint3"),))).located
    assert not verdict("large", (STRIBECK,), found()).located
