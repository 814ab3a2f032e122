"""An identification that closes its own ambiguities, where somebody can record a motion (:mod:`fitting.loop.closing`).

The stages up to the attribution are run again with every motion that is recorded; both stages are refitted and the
report is written once, in the end, of all recordings.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Self

from daq.recording import Recording
from fitting.loop.closing import Asked, Recorder, Step, close
from fitting.loop.residual_loop import term_from_json, term_to_json
from fitting.loop.session import Request, Session
from fitting.pipeline.stages import STEPS, Progress, computed, motion_of, opened, reported
from fitting.residual.findings import Hypothesis

#: The stages that are run again.
_SEARCH = (*takewhile(lambda stage: stage != "attribution", STEPS), "attribution")
#: Share of the progress bar of the first identification, of each one more, and where the rest begins.
_FIRST, _MORE = 0.5, 0.2


def _quiet(fraction: float, text: str) -> None:
    return None


def identify_and_resolve(request: Request, record: Recorder, progress: Progress = _quiet) -> dict[str, Any]:
    """As :func:`fitting.pipeline.stages.identify`; what stays ambiguous is recorded, and identified again.

    Parameters
    ----------
    request : what to identify
    record : whoever can record a motion of this machine
    progress : called with the share done and plain words

    Returns
    -------
    The report; ``loop.resolution`` has the motions that were made, with explanations before and after each.

    Raises
    ------
    InputError
        One line about the machine file or a recording; nothing is written then.
    """
    session = opened(request)
    first = _Run.of(request, session, lambda s, text: progress(_FIRST * s, text))
    begun = [0]

    def recorded(asked: Asked, number: int) -> Recording:
        begun[0] = number
        progress(_FIRST + _MORE * (number - 1), f"recording {asked.text}")
        return record(asked, number)

    last, steps = close(first, recorded)
    done = _FIRST + _MORE * begun[0]
    results = last.results | {"resolution": {"steps": [_step_to_json(step) for step in steps]}}
    results = computed(("refit",), request, last.session, results, lambda s, text: progress(done, text))
    return reported(request, last.session, results, lambda s, text: progress(max(s, done), text))


@dataclass(frozen=True)
class _Run:
    """Results of the stages up to the attribution."""

    request: Request
    session: Session
    results: dict[str, dict[str, Any]]

    @classmethod
    def of(cls, request: Request, session: Session, progress: Progress = _quiet) -> Self:
        return cls(request, session, computed(_SEARCH, request, session, {}, progress))

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        return tuple(
            Hypothesis(tuple(term_from_json(term) for term in h["terms"]), h["probability"])
            for h in self.results["attribution"]["hypotheses"]
        )

    @property
    def found(self) -> bool:
        return bool(self.results["attribution"]["accepted"])

    def question(self) -> Asked | None:
        experiment = self.results["attribution"]["next_experiment"]
        if experiment is None or "program" not in experiment:
            return None
        program = experiment["program"]
        motion = motion_of(program, self.session.machine.name)
        return Asked(motion, program["text"], tuple(experiment["separates"]), program["chance"])

    def with_recording(self, recording: Recording) -> Self:
        return type(self).of(self.request, self.session.with_recording(recording))


def _step_to_json(step: Step) -> dict[str, Any]:
    asked = step.asked
    return {
        "before": [_hypothesis_to_json(h) for h in step.before],
        "motion": {
            "text": asked.text,
            "rods": asked.motion.rods,
            "seconds": asked.motion.seconds,
            "recording": step.recording,
            "separates": list(asked.separates),
            "chance": asked.chance,
        },
        "after": [_hypothesis_to_json(h) for h in step.after],
    }


def _hypothesis_to_json(hypothesis: Hypothesis) -> dict[str, Any]:
    return {"terms": [term_to_json(term) for term in hypothesis.terms], "probability": hypothesis.probability}
