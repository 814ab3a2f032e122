"""What stands in a place, by log odds: names and laws, other joints, what was refused, laws of a mismatch."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.effects import effect, line_effect
from fitting.residual.confirmation.confirmation import OnValidate
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Attribution
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term
from fitting.selection.confirm import Answer
from fitting.selection.decision import Rated, Slot, decided, family, here, instead, nothing_more, open_place
from fitting.selection.gaps import GapPosterior, GapSet
from fitting.selection.refusals import Refusals

LOAD, PRESSURE = Term(effect("load_dependent_friction"), 1), Term(effect("pressure_dependent_friction"), 1)
CURVE = Law("link_angle", None, False, False, tuple(np.linspace(0, 1, 20)))
LAW, OTHER_LAW = Term(CURVE, 1), Term(replace(CURVE, signal="time"), 1)
ELSEWHERE = Term(effect("load_dependent_friction"), 2)


def score(term: Term) -> Score:
    return Score(term, 50.0, 1, (1.0,), (0.1,), (1.0,), 0.5, np.eye(1))


def rated(term: Term, odds: float) -> Rated:
    return Rated(score(term), odds, odds, odds, 0.0)


def by_share(*shares: tuple[Term, float]) -> list[Rated]:
    """Explanations with these probabilities, the rest being nothing's."""
    nothing = 1.0 - sum(p for _, p in shares)
    return [rated(term, float(np.log(p / nothing))) for term, p in sorted(shares, key=lambda own: -own[1])]


def accepted(term: Term, confirmed: float = 40.0) -> Accepted:
    return Accepted(score(term), (), HeldOut(gain=confirmed, z=5.0, blocks=10, alike=confirmed), 10.0)


def refused(term: Term, confirmed: float = 40.0) -> Answer:
    return Answer("it does not hold", accepted(term, confirmed), None, False)


def test_laws_are_taken_where_together_they_have_more_than_their_share() -> None:
    one = by_share((LOAD, 0.915), (PRESSURE, 0.005), (LAW, 0.05), (OTHER_LAW, 0.025))
    assert decided(one).term == LAW, "a twentieth beside one name"
    assert decided(one, family(LOAD)).term == LOAD, "a fifth where that name is there already"
    assert decided(one, family(PRESSURE)).term == LAW, "and not where another one is"
    assert decided(by_share((LOAD, 0.6), (PRESSURE, 0.24), (LAW, 0.09), (OTHER_LAW, 0.05))).term == LOAD, (
        "a fifth of all"
    )
    several = [(Term(effect(name), 1), 0.155) for name in ("stribeck", "payload", "gas_spring")]
    several += [(LOAD, 0.155), (PRESSURE, 0.155)]
    assert decided(by_share(*several, (LAW, 0.18))).term != LAW, "more probable than each name, and not a fifth of all"
    assert decided(by_share(*several, (LAW, 0.2))).term == LAW
    assert decided(by_share((LAW, 0.9))).term == LAW


@pytest.mark.parametrize("odds", [0.5, 1.9, 60.0])
def test_what_is_at_another_joint_counts_as_far_as_it_is_nothing_beside_the_term(odds: float) -> None:
    there = 1 / (1 + np.exp(-2.0))

    def slot(beside: float) -> Slot:
        both = [rated(LOAD, 2.0), rated(ELSEWHERE, odds)]  # the term's own joint first, whatever is more probable
        return Slot.of(accepted(LOAD), instead(both, {family(ELSEWHERE): beside}))

    both_are_there = slot(odds)
    assert (both_are_there.probability, both_are_there.nothing) == pytest.approx((there, 1 - there))
    one_of_them = slot(-50.0)
    assert one_of_them.nothing < both_are_there.nothing and one_of_them.probability < there
    assert one_of_them.alternatives[0][0].term == (LOAD if odds < 2.0 else ELSEWHERE)


def test_what_has_its_place_is_not_closed_by_what_was_refused_beside_it() -> None:
    names, laws = Refusals(), Refusals()
    names.add(rated(PRESSURE, 9.0), refused(PRESSURE), [LOAD])
    laws.add(rated(OTHER_LAW, 9.0), refused(OTHER_LAW), [LAW])
    for refusals, term in ((names, LOAD), (laws, LAW)):
        candidates = [rated(term, 6.0), rated(Term(effect("stribeck"), 1), 5.0)]
        assert term not in [r.term for r in refusals.without(candidates, [], True)]
        assert refusals.without(candidates, [], True, family(term))[0].term == term


def test_what_left_out_rows_confirm_of_a_refused_name_is_not_nothings() -> None:
    confirmed, chance = Refusals(), Refusals()
    confirmed.add(rated(LOAD, 9.0), refused(LOAD), [])
    chance.add(rated(LOAD, 9.0), refused(LOAD, confirmed=2.0), [])
    nothing = [open_place([], own.unknown.values())[0][1] for own in (confirmed, chance)]
    assert nothing[0] == pytest.approx(1 / (1 + np.exp(9.0))) and nothing[1] == 1.0
    against = OnValidate(gain=-30.0, expected=10.0, spread=6.0, predicted=-30.0, entered=True)
    refuted = Refusals()
    refuted.add(rated(LOAD, 9.0), replace(refused(LOAD), validate=against), [])
    assert open_place([], refuted.unknown.values())[0][1] == pytest.approx(1 / (1 + np.exp(9.0 - 15.0)))
    found = Attribution(None, None, (), (), (), (), places=(((None, nothing[0]),),))  # type: ignore[arg-type]
    assert found.verdict == "unexplained"


def test_places_keep_what_is_right_of_their_probabilities_when_one_explanation_is_refuted() -> None:
    place = ((LOAD, 0.7), (PRESSURE, 0.2), (None, 0.1))
    found = Attribution(None, None, (), (), (), (), places=(place,))  # type: ignore[arg-type]
    (left,) = found.narrowed({LOAD.family: "it fits all samples worse"}).places
    assert [term for term, _ in left] == [PRESSURE, None]
    assert [p for _, p in left] == pytest.approx([2 / 3, 1 / 3])


@pytest.mark.parametrize(("nothing", "said"), [(0.3, "unexplained"), (0.6, "effect_added")])
def test_a_spectral_line_alone_does_not_hide_what_else_is_missing(nothing: float, said: str) -> None:
    line, place = accepted(Term(line_effect(), 0, {"frequency": 1.0})), ((None, nothing), (LOAD, 1.0 - nothing))
    assert Attribution(None, None, (line,), (), (), (), places=(place,)).verdict == said  # type: ignore[arg-type]


def part(name: str) -> Any:
    return SimpleNamespace(effect=SimpleNamespace(id=name, between_sensors=False), columns=np.ones((3, 1)), shape={})


@pytest.mark.parametrize(
    ("encoder", "pin", "law", "said"),
    [
        (0.60, 0.00, 0.39, ["time/None"]),
        (0.93, 0.00, 0.06, ["time/None"]),
        (0.96, 0.00, 0.03, ["encoder_offset"]),
        (0.60, 0.25, 0.14, ["encoder_offset"]),
    ],
)
def test_a_law_of_a_mismatch_is_said_where_it_has_too_much_beside_the_name(
    encoder: float, pin: float, law: float, said: list[str]
) -> None:
    of_law = GapSet(law=SimpleNamespace(law=SimpleNamespace(signal="time", other=None)))  # type: ignore[arg-type]
    sets = [(GapSet((part("encoder_offset"),)), encoder), (GapSet((part("linkage_geometry"),)), pin), (of_law, law)]
    posterior = GapPosterior(None, (*sets, (GapSet(), 0.01)))  # type: ignore[arg-type]
    assert [one.name for one in posterior.conclusions()] == said
    left = posterior.without(["encoder_offset"])
    assert all("encoder_offset" not in own.names for own, _ in left.sets) and len(left.sets) == 3


def test_nothing_more_is_of_all_joints_and_a_place_of_one() -> None:
    both = by_share((LOAD, 0.52), (ELSEWHERE, 0.45))
    assert nothing_more(both) == pytest.approx(0.03)
    assert [r.term for r in here(both)] == [LOAD]
    slot = Slot.of(accepted(LOAD), instead(both, {family(ELSEWHERE): -20.0}))
    assert slot.nothing < 0.05 and [r.term for r, _ in slot.rivals()] == [ELSEWHERE], "a set of two joints"
