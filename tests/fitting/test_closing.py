"""Closing an ambiguity: when a motion is asked for, who records it, when it ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from daq.motion_files import Motion
from daq.recordings.recording import Recording
from fitting.effects import effect
from fitting.loop.closing import Asked, close, rivals_of, settled
from fitting.loop.session import Request
from fitting.pipeline import resolving
from fitting.pipeline.results.loop_results import AcceptedTerm, Attributed, Designed, Program, Resolution
from fitting.planning.next_experiment import MOST_RECORDINGS
from fitting.report.schema.loop import ResolutionStep
from fitting.report.wording import resolution
from fitting.residual.confirmation.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Attribution, Hypothesis
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term
from fitting.selection.decision import Rated, Slot

LOAD, PRESSURE = Term(effect("load_dependent_friction"), 1), Term(effect("pressure_dependent_friction"), 1)
OFFSET = Term(effect("pressure_offset"), 0)
LAW = Term(Law("link_angle", None, False, False, tuple(np.linspace(0, 1, 20))), 1)


def stated(*chances: float) -> tuple[Hypothesis, ...]:
    return tuple(Hypothesis((term,), p) for term, p in zip((LOAD, PRESSURE, LAW), chances, strict=False))


def asked(rods="pinned") -> Asked:
    time = np.linspace(0.0, 30.0, 31)
    motion = Motion("arm", rods, time, {"joint2": 0.1 * np.sin(time)})
    return Asked(motion, "a staircase", ("load_dependent_friction", "pressure_dependent_friction"), 0.6)


@dataclass(frozen=True)
class Told:
    """What each identification would state, in the order in which recordings come."""

    states: tuple[tuple[Hypothesis, ...], ...]
    questions: tuple[Asked | None, ...] = (asked(), asked(), asked())
    recordings: tuple[Recording, ...] = ()
    found: bool = True

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        return self.states[len(self.recordings)]

    def question(self) -> Asked | None:
        return self.questions[len(self.recordings)]

    def with_recording(self, recording: Recording) -> Told:
        return replace(self, recordings=(*self.recordings, recording))


class Operator:
    """Records what it is asked for."""

    def __init__(self) -> None:
        self.made: list[tuple[Asked, int]] = []

    def __call__(self, asked: Asked, number: int) -> Recording:
        self.made.append((asked, number))
        return Recording("arm", asked.role, f"motion-{number}", "", 50.0, np.arange(2.0), {})


def test_motions_are_recorded_until_one_explanation_has_95_percent():
    operator = Operator()
    told = Told((stated(0.53, 0.44), stated(0.8, 0.2), stated(0.97, 0.02)))
    last, steps = close(told, operator)
    assert [number for _, number in operator.made] == [1, 2]
    assert [r.file for r in last.recordings] == [step.recording for step in steps] == ["motion-1", "motion-2"]
    assert [step.before[0].probability for step in steps] == [0.53, 0.8]
    assert [step.after[0].probability for step in steps] == [0.8, 0.97]
    assert settled(last.hypotheses)


def test_one_motion_is_enough_where_it_settles_the_question():
    operator = Operator()
    _, steps = close(Told((stated(0.53, 0.44), stated(0.96, 0.03))), operator)
    assert len(steps) == len(operator.made) == 1


def test_no_more_motions_are_made_than_a_design_counts_on():
    operator = Operator()
    last, steps = close(Told((stated(0.5, 0.4),) * 6, (asked(),) * 6), operator)
    assert len(steps) == len(operator.made) == MOST_RECORDINGS
    assert not settled(last.hypotheses)


@pytest.mark.parametrize(
    "told",
    [
        Told((stated(0.95, 0.02),)),
        Told(((Hypothesis((), 0.7),),), found=False),
        Told((stated(0.5, 0.4),), questions=(None,)),
    ],
    ids=["settled", "nothing missing", "no motion helps"],
)
def test_no_recording_is_asked_for_without_an_ambiguity(told):
    operator = Operator()
    last, steps = close(told, operator)
    assert (last, steps, operator.made) == (told, (), [])


def test_a_motion_of_free_cylinders_is_recorded_as_unloaded():
    assert asked("unpinned").role == "unloaded"
    assert asked("pinned").role == "train"


def test_who_cannot_record_ends_it():
    def nobody(asked: Asked, number: int) -> Recording:
        raise OSError("the arm is switched off")

    with pytest.raises(OSError, match="switched off"):
        close(Told((stated(0.5, 0.4),) * 3), nobody)


def score(term: Term) -> Score:
    return Score(term, 50.0, 1, (1.0,), (0.1,), True, 0.5, np.eye(1))


def accepted(term: Term, probability: float, *rivals: tuple[Term, float]) -> Accepted:
    held_out = HeldOut(gain=40.0, z=5.0, blocks=10)
    return Accepted(
        score(term),
        tuple(score(t) for t, _ in rivals),
        held_out,
        10.0,
        probability=probability,
        rival_probabilities=tuple(p for _, p in rivals),
    )


def attribution(item: Accepted, hypotheses: tuple[Hypothesis, ...]) -> Attribution:
    """What was found, with one place whose alternatives are these hypotheses of one term each."""
    place = tuple((h.terms[0] if h.terms else None, h.probability) for h in hypotheses)
    return Attribution(None, None, (item,), (), (), (), places=(place,))  # type: ignore[arg-type]


def test_the_members_of_a_set_are_told_apart():
    item = accepted(LOAD, 0.53, (PRESSURE, 0.44))
    assert rivals_of(item, attribution(item, stated(0.53, 0.44, 0.03))) == ((LOAD, PRESSURE), (0.53, 0.44))


def test_a_name_that_only_a_law_keeps_from_95_percent_is_told_from_that_law():
    item = accepted(LOAD, 0.8)
    assert rivals_of(item, attribution(item, stated(0.8, 0.03, 0.16)))[0] == (LOAD, LAW)


def test_a_name_beside_another_finding_keeps_its_own_place():
    """Explanations of two places: the second finding's alternatives are in the second place."""
    item = accepted(LOAD, 0.6)
    places = (((OFFSET, 0.96), (None, 0.04)), ((LOAD, 0.625), (PRESSURE, 0.3125), (LAW, 0.0625)))
    found = replace(attribution(item, ()), places=places)
    assert [h.probability for h in found.hypotheses[:2]] == pytest.approx([0.6, 0.3])
    terms, chances = rivals_of(item, found)
    assert terms[:2] == (LOAD, PRESSURE) and chances[:2] == pytest.approx((0.6, 0.3))


def test_what_has_95_percent_has_no_rivals():
    item = accepted(LOAD, 0.97)
    assert rivals_of(item, attribution(item, stated(0.97, 0.02, 0.01))) == ((LOAD,), (0.97,))


# --- in the report ------------------------------------------------------------------------------------------------


def test_the_report_says_what_was_ambiguous_what_was_recorded_and_what_it_is_now():
    def hypothesis(id: str, probability: float) -> dict[str, object]:
        return {"effects": [{"id": id, "joint": "joint2"}], "laws": [], "probability": probability}

    motion = {
        "text": "a staircase of constant speeds of joint2",
        "rods": "pinned",
        "seconds": 60.0,
        "recording": "resolve-1.parquet",
        "separates": ["load_dependent_friction", "pressure_dependent_friction"],
        "chance": 0.4,
    }
    before = [hypothesis(LOAD.id, 0.53), hypothesis(PRESSURE.id, 0.44), hypothesis("stribeck", 0.01)]
    step = {"before": before, "motion": motion, "after": [hypothesis(LOAD.id, 0.97)]}
    ResolutionStep.model_validate(step)
    titles = {LOAD.id: "Friction by load", PRESSURE.id: "Friction by pressure"}
    assert resolution({"resolution": [step]}, titles) == [
        {
            "before": "friction by load at joint2 (53\u202f%) or friction by pressure at joint2 (44\u202f%)",
            "motion": "a staircase of constant speeds of joint2, 60 s",
            "after": "friction by load at joint2 (97\u202f%)",
        }
    ]
    assert resolution({}, titles) == []


def test_the_program_identifies_again_with_every_motion_and_reports_once(monkeypatch, tmp_path):
    """Its stages stand in: what is checked is which recordings they see, and what the report is made of."""

    @dataclass(frozen=True)
    class Data:
        recordings: tuple[str, ...] = ("train",)
        machine = SimpleNamespace(name="arm")

        def with_recording(self, recording: Recording) -> Data:
            return replace(self, recordings=(*self.recordings, recording.file))

    seen: list[tuple[tuple[str, ...], tuple[str, ...]]] = []
    motion = asked().motion
    program = Program(motion.rods, motion.time, {"joint2": np.zeros(31)}, "a swing", 0.4)
    load = AcceptedTerm(LOAD)
    chances = {1: (0.6, 0.3), 2: (0.98, 0.01)}

    def computed(stages, request, session, results, progress):
        seen.append((tuple(stages), session.recordings))
        states = stated(*chances[len(session.recordings)])
        designed = Designed({"separates": [LOAD.id]}, program)
        return results.having(Attributed("ambiguous", accepted=(load,), hypotheses=states, next_experiment=designed))

    monkeypatch.setattr(resolving, "opened", lambda request: Data())
    monkeypatch.setattr(resolving, "computed", computed)
    monkeypatch.setattr(resolving, "reported", lambda request, session, results, progress: results)
    content = resolving.identify_and_resolve(Request(tmp_path, (), tmp_path), Operator())
    before_refit = ("check", "cylinder_stage", "rigid_body_stage", "residual", "attribution")
    both = ("train", "motion-1")
    assert seen == [(before_refit, ("train",)), (before_refit, both), (("refit",), both)]
    (step,) = content[Resolution].steps
    assert [h.probability for h in step.before] == [0.6, 0.3]
    assert [h.probability for h in step.after] == [0.98, 0.01]
    assert step.motion == {
        "text": "a swing",
        "rods": "pinned",
        "seconds": 30.0,
        "recording": "motion-1",
        "separates": [LOAD.id],
        "chance": 0.4,
    }


def slot(term: Term, *alternatives: tuple[Term, float]) -> Slot:
    rated = tuple((Rated(score(t), 3.0, 3.0, 3.0, 0.0), p) for t, p in alternatives)
    return Slot(accepted(term, 1.0), rated, rated[0][1], 1.0 - sum(p for _, p in alternatives))


def test_what_the_posterior_calls_improbable_is_not_added():
    assert not slot(LOAD, (LOAD, 0.53), (PRESSURE, 0.44)).improbable
    assert not slot(LOAD, (LOAD, 0.4), (PRESSURE, 0.3), (LAW, 0.2)).improbable, "a set counts as one"
    assert slot(LOAD, (LOAD, 0.06), (LAW, 0.93)).improbable
    assert not slot(LAW, (LAW, 0.93), (LOAD, 0.06)).improbable
    assert not slot(LAW, (LAW, 0.3), (LOAD, 0.6)).improbable, "a law that may be a name claims less than the name"
    assert slot(LAW, (LAW, 0.3), (LOAD, 0.04)).improbable


def test_what_was_refused_later_is_not_shown_as_certain_and_its_evidence_is_not_nothings():
    found = attribution(accepted(LOAD, 0.99), stated(0.99, 0.008))
    assert found.verdict == "effect_added" and found.hypotheses[0].probability == 0.99
    refused = found.refusing({LOAD.family: "it does not hold"})
    assert not refused.accepted and all(LOAD not in h.terms for h in refused.hypotheses)
    assert max((h.probability for h in refused.hypotheses), default=0.0) <= 0.01
    assert refused.nothing < 0.5 and refused.verdict == "unexplained"


@pytest.mark.parametrize(("nothing", "said"), [(0.05, "unexplained"), (0.49, "unexplained"), (0.51, "nothing_missing")])
def test_nothing_that_is_improbable_is_never_nothing_missing(nothing: float, said: str):
    place = ((None, nothing), (LOAD, 1.0 - nothing))
    assert Attribution(None, None, (), (), (), (), places=(place,)).verdict == said  # type: ignore[arg-type]
