"""The next experiment, designed: which motion separates rivals, and how far.

For every motion of a menu, and for motions searched for the purpose, the odds that the loop would then state are
predicted, for the sizes that were fitted (:mod:`fitting.planning.separation`): the motion goes through the filters, the
rivals' columns are built on it with the model's own forces, and the base model is projected out together with
everything recorded so far (:mod:`fitting.planning.question`).
The best is named with its expected separation, and can be run: the set is *closable*. Where no motion of this arm is
expected to leave a single name, that is reported, with how little the choice matters to the efforts, and which of the
catalogue's experiments need no motion (vented chambers, an inclinometer).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.motion_files import Motion
from fitting.effects.base import Effect
from fitting.excitation.experiments import Arm, menu
from fitting.excitation.fourier import Series, random_series, varied
from fitting.excitation.limits import HydraulicLimits, limits_of_machine, limits_used
from fitting.planning.guess import Guess, worst_friction
from fitting.planning.question import Question
from fitting.planning.separation import Separation
from fitting.regression.prior import Prior
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term

#: Chance of a single name from which on an experiment is worth making.
ENOUGH = 0.8
#: Repetitions beyond which a motion does not separate the rivals for practical purposes.
MOST_RECORDINGS = 4
_GENERATIONS, _PER_GENERATION = 3, 8
#: Share of every limit that a motion may use.
_USE = 0.92
_SHRINKS = 12  # by 0.85: what is left of a motion after that says nothing
# Standard deviations that a motion of the menu may be behind: people see what it does.
_SIMPLER = 0.25


@dataclass(frozen=True)
class Option:
    """One experiment with what it promises.

    Attributes
    ----------
    kind : of :data:`fitting.excitation.experiments.KINDS`, ``again`` (what was recorded, once more) or ``designed``
    text : what is done
    motion : the motion program; None for ``again``
    expected : separation of the rivals by all data, this experiment included
    """

    kind: str
    text: str
    motion: Motion | None
    expected: Separation


@dataclass(frozen=True)
class NextExperiment:
    """The next step about a set of rivals.

    Attributes
    ----------
    rivals : the terms that the data cannot separate, best first
    now : their separation by what is recorded
    options : all experiments that were weighed, best first; what was recorded, once more, last
    recordings : how often the best one has to be recorded to be enough; None if no motion separates the rivals
    chance : of a single name after these recordings, or with the best motion once
    by_hand : experiments of the catalogue that no motion makes: an instrument, a vented chamber, another load
    """

    rivals: tuple[Term, ...]
    now: Separation
    options: tuple[Option, ...]
    recordings: int | None
    chance: float
    by_hand: tuple[str, ...]

    @property
    def best(self) -> Option | None:
        """The experiment to make; None if no motion separates the rivals."""
        return self.options[0] if self.closable else None

    @property
    def closable(self) -> bool:
        """True where a motion of this arm is expected to leave a single name."""
        return self.recordings is not None

    def to_json(self, machine: Machine, motion_file: str | None = None) -> dict[str, Any]:
        """Return ``loop.next_experiment`` of the report; ``motion_file`` is where the motion was written."""
        names = [joint.name for joint in machine.joints]
        ids = self._labels(names)
        joint = self.rivals[0].joint
        best = self.best
        return {
            "motion": self._text(),
            "closable": self.closable,
            "why": self._why(names),
            "separates": ids,
            "joint": None if joint is None else names[joint],
            "kind": None if best is None else best.kind,
            "motion_file": motion_file,
            "rods": None if best is None or best.motion is None else best.motion.rods,
            "seconds": None if best is None or best.motion is None else best.motion.seconds,
            "recordings": self.recordings,
            "now": _separation_to_json(self.now),
            "expected": None if best is None else _separation_to_json(best.expected),
            "menu": [
                {"kind": option.kind, "motion": option.text, **_separation_to_json(option.expected)}
                for option in self.options
            ],
            "otherwise": list(self.by_hand),
        }

    def _text(self) -> str:
        best = self.best
        if best is None:
            return Sentence("fitting.either_motion", motions=self.by_hand)
        if self.recordings == 1:
            return best.text
        return Sentence("fitting.record_times", motion=best.text, recordings=self.recordings)

    def _labels(self, names: Sequence[str]) -> list[str]:
        return [term_label(term, names) for term in self.rivals]

    def _why(self, names: Sequence[str]) -> str:
        best, most = self.best, self.options[0]
        first = Sentence("fitting.differ_these_recordings", rivals=self._labels(names), now=_differ(self.now))
        if best is not None:
            return Sentence(
                "fitting.closable_by_motion",
                first=first,
                expected=_differ(best.expected),
                recordings=self.recordings,
                chance=100 * self.chance,
            )
        apart = 100 * np.sqrt(most.expected.share)
        alike = Sentence("fitting.best_motion_cannot_tell", first=first, expected=_differ(most.expected), apart=apart)
        return Sentence("fitting.would_tell", first=alike, by_hand=self.by_hand) if self.by_hand else alike


def term_label(term: Term, joints: Sequence[str]) -> str:
    """Name a term briefly: an effect's id, or the law's variable."""
    content = term.content
    return Sentence("fitting.law_of", variable=content.variable(tuple(joints))) if isinstance(content, Law) else term.id


def _differ(value: Separation) -> str:
    return Sentence(
        "fitting.standard_deviations_effect", standard_deviations=value.standard_deviations, share=100 * value.share
    )


def _separation_to_json(value: Separation) -> dict[str, float]:
    return {
        "chi_square": value.chi_square,
        "standard_deviations": value.standard_deviations,
        "own_share": value.share,
        "needed": value.needed,
        "probability": value.probability,
    }


def design_next(
    model: Model,
    rivals: Sequence[Term],
    prior: Prior,
    *,
    chances: Sequence[float] | None = None,
    seconds: float = 30.0,
    hydraulic: HydraulicLimits | None = None,
    generations: int = _GENERATIONS,
) -> NextExperiment:
    """Design the experiment that separates rivals.

    Parameters
    ----------
    model : the fitted model; if it holds one of the rivals already, that one is taken out first
    rivals : two or more terms that explain the same residual
    prior : what the fit knew beforehand
    chances : that each of them is right; the same for all if None
    seconds : length of the motions
    hydraulic : supply flow and chamber pressures; those of the machine file for the fitted parameters if None
    generations : of the search for a motion of its own; 0 leaves it out

    Raises
    ------
    ValueError
        For fewer than two rivals.
    """
    if len(rivals) < 2:
        raise ValueError("an experiment tells two rivals or more apart")
    question = Question(model, tuple(rivals), prior, hydraulic or supply_of(model), _normed(chances))
    design = model.design
    arms = [
        Arm(design.machine, joint, seconds, _USE, question.holding, question.hydraulic, design.parameters.base)
        for joint in question.suspects
    ]
    experiments = [each for arm in arms for each in menu(arm)]
    options = [
        Option(each.kind, each.text, each.motion, apart)
        for each, apart in zip(
            experiments, question.separations([question.segment(e.motion) for e in experiments]), strict=True
        )
    ]
    options.append(Option("again", Sentence("fitting.training_motion_once_more"), None, question.again(seconds)))
    designed = _designed(question, np.random.default_rng(0), seconds, generations)
    if designed is not None:
        options.append(designed)
    options.sort(key=lambda o: (o.motion is None, -o.expected.margin + (_SIMPLER if o.kind == "designed" else 0.0)))
    times, chance = _recordings(question, options[0], seconds)
    effects = [term.content for term in rivals if isinstance(term.content, Effect)]
    by_hand = tuple(dict.fromkeys(effect.experiment for effect in effects if not effect.by_motion))
    return NextExperiment(tuple(rivals), question.now, tuple(options), times, chance, by_hand)


def supply_of(model: Model) -> HydraulicLimits:
    """Return supply flow and chamber pressures of the machine file, with fitted loads and friction."""
    design, theta = model.design, model.fit.theta
    parameters, machine = design.parameters, design.machine
    drive = tuple(theta[parameters.drive_slice(joint)] for joint in range(len(machine.joints)))
    values = theta[parameters.base_slice]
    fitted = Guess(values, drive, np.zeros(len(drive)), "parameters as fitted", measured=True)
    return limits_of_machine(machine, values, worst_friction(machine, fitted))


def _normed(chances: Sequence[float] | None) -> tuple[float, ...] | None:
    """Normalise chances to sum one, none of them nothing."""
    if chances is None:
        return None
    shares = np.maximum(np.asarray(chances, dtype=float), 1e-3)
    return tuple((shares / shares.sum()).tolist())


def _recordings(question: Question, option: Option, seconds: float) -> tuple[int | None, float]:
    """Compute an experiment's needed recordings, None if more than is sensible; and the chance."""
    if option.expected.probability >= ENOUGH:
        return 1, option.expected.probability
    repeats = range(2, MOST_RECORDINGS + 1)
    separations = (
        (question.again(times * seconds) for times in repeats)
        if option.motion is None
        else question.repeated(option.motion, repeats)
    )
    for times, found in zip(repeats, separations, strict=True):
        if found.probability >= ENOUGH:
            return times, found.probability
    return None, option.expected.probability


def _designed(question: Question, rng: np.random.Generator, seconds: float, generations: int) -> Option | None:
    """Search a motion of all joints for the separation itself: random series, the best of them varied.

    None if none of them is inside the limits.
    """
    machine = question.model.design.machine
    pool: list[tuple[Separation, Series]] = []
    for generation in range(generations):
        if not pool:
            trials = [random_series(machine, seconds, rng, question.suspects) for _ in range(2 * _PER_GENERATION)]
        else:
            trials = [varied(pool[k % min(3, len(pool))][1], rng, 0.5 / generation) for k in range(_PER_GENERATION)]
        allowed = [series for trial in trials if (series := _allowed(question, trial)) is not None]
        segments = [question.segment_of(series.states(machine, _USE)) for series in allowed]
        pool += zip(question.separations(segments), allowed, strict=True)
        pool.sort(key=lambda entry: -entry[0].margin)
    if not pool:
        return None
    motion = pool[0][1].motion(machine, _USE)
    expected = question.separations([question.segment(motion)])[0]
    return Option("designed", Sentence("fitting.motion_all_joints_designed"), motion, expected)


def _allowed(question: Question, series: Series) -> Series | None:
    """Bring the series inside all limits: shrunk about its home, its home moved to the middle; None if useless."""
    limits = question.hydraulic
    if limits.flow is None and limits.pressure is None:
        return series
    machine, base = question.model.design.machine, question.model.design.parameters.base
    for _ in range(_SHRINKS):
        used = limits_used(machine, limits, *series.states(machine, _USE), base)
        if all(each.used <= _USE for each in used if each.quantity in ("flow", "pressure")):
            return series
        series = replace(series, amplitude=0.85 * series.amplitude, home=0.85 * series.home)
    return None
