"""An identification that closes its own ambiguities, where somebody can record a motion (:mod:`fitting.loop.closing`).

The stages up to the attribution are run again with every motion that is recorded; both stages are refitted and the
report is written once, in the end, of all recordings.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Self

from daq.messages import Sentence
from daq.recordings.recording import Recording
from fitting.loop.closing import Asked, Recorder, Step, close
from fitting.loop.session import Request, Session
from fitting.pipeline.results.loop_results import Attributed, ClosingStep, Resolution
from fitting.pipeline.results.stage_results import StageResults
from fitting.pipeline.stages import STEPS, computed, motion_of, opened, reported
from fitting.progress import Progress, quiet
from fitting.residual.findings import Hypothesis

#: The stages that are run again.
_SEARCH = (*takewhile(lambda stage: stage != "attribution", STEPS), "attribution")
#: Share of the progress bar of the first identification, of each one more, and where the rest begins.
_FIRST, _MORE = 0.5, 0.2


def identify_and_resolve(request: Request, record: Recorder, progress: Progress = quiet) -> dict[str, Any]:
    """Run :func:`fitting.pipeline.stages.identify`; what is ambiguous is recorded, and identified again.

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
        progress(_FIRST + _MORE * (number - 1), Sentence("fitting.recording_motion", motion=asked.text))
        return record(asked, number)

    last, steps = close(first, recorded)
    done = _FIRST + _MORE * begun[0]
    results = last.results.having(Resolution(tuple(_closing(step) for step in steps)))
    results = computed(("refit",), request, last.session, results, lambda s, text: progress(done, text))
    return reported(request, last.session, results, lambda s, text: progress(max(s, done), text))


@dataclass(frozen=True)
class _Run:
    """Results of the stages up to the attribution."""

    request: Request
    session: Session
    results: StageResults

    @classmethod
    def of(cls, request: Request, session: Session, progress: Progress = quiet) -> Self:
        return cls(request, session, computed(_SEARCH, request, session, StageResults(), progress))

    @property
    def hypotheses(self) -> tuple[Hypothesis, ...]:
        return self.results[Attributed].hypotheses

    @property
    def found(self) -> bool:
        return bool(self.results[Attributed].accepted)

    def question(self) -> Asked | None:
        experiment = self.results[Attributed].next_experiment
        if experiment is None or experiment.program is None:
            return None
        program = experiment.program
        motion = motion_of(program, self.session.machine.name)
        return Asked(motion, program.text, tuple(experiment.content["separates"]), program.chance)

    def with_recording(self, recording: Recording) -> Self:
        return type(self).of(self.request, self.session.with_recording(recording))


def _closing(step: Step) -> ClosingStep:
    asked = step.asked
    motion = {
        "text": asked.text,
        "rods": asked.motion.rods,
        "seconds": asked.motion.seconds,
        "recording": step.recording,
        "separates": list(asked.separates),
        "chance": asked.chance,
    }
    return ClosingStep(step.before, motion, step.after)
