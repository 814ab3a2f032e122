"""The next experiment, designed: which motion separates rivals, and how far.

For every motion of a menu, and for motions searched for the purpose, the odds that the loop would then state are
predicted, for the sizes that were fitted (:mod:`fitting.planning.separation`): the motion goes through the filters, the
rivals' columns are built on it with the model's own forces, and the base model is projected out together with
everything recorded so far (:class:`Question`).
The best is named with its expected separation, and can be run: the set is *closable*. Where no motion of this arm is
expected to leave a single name, that is reported, with how little the choice matters to the efforts, and which of the
catalogue's experiments need no motion (vented chambers, an inclinometer).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from daq.motion_files import Motion
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.excitation.experiments import Arm, menu
from fitting.excitation.fourier import Series, random_series, varied
from fitting.excitation.limits import HydraulicLimits, holding_efforts, limits_of_machine, limits_used
from fitting.planning.guess import Guess, worst_friction
from fitting.planning.planned import States, chamber_models, planned_segment, planned_views, segment_of_states
from fitting.planning.separation import Rival, Separation, leads, products, projected, separation
from fitting.regression.design import build_design, whitened
from fitting.regression.prior import Prior, with_prior
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, extra_columns
from fitting.signals.preparation import Segment

#: Shapes of a rival's grid that are looked at.
_MOST_SHAPES = 16
#: Chance of a single name from which on an experiment is worth making.
ENOUGH = 0.8
#: Repetitions beyond which a motion does not separate the rivals for practical purposes.
MOST_RECORDINGS = 4
_GENERATIONS, _PER_GENERATION = 3, 8
#: Share of every limit that a motion may use.
_USE = 0.92
_SHRINKS = 12  # by 0.85: what is left of a motion after that determines nothing
# Standard deviations that a motion of the menu may be behind: people see what it does.
_SIMPLER = 0.25


def _fitted(apart: FloatArray, rival: Term, place: slice) -> FloatArray:
    """Return a rival's values fitted without the others; what was moved into signals is put back first."""
    S, target = apart[:-1, :-1], apart[:-1, -1]
    if rival.rebuilt:
        target = target + S[:, place] @ np.asarray(rival.rebuilt)
    return np.asarray(np.linalg.pinv(S[place, place], rcond=1e-8, hermitian=True) @ target[place])


def _shapes(model: Model, rival: Term) -> list[Term]:
    """Return a rival in fitted and other shapes of its grid: a wrong one adapts to a new recording."""
    effect = rival.content
    if not isinstance(effect, Effect):
        return [rival]
    chosen = {key: value for key, value in rival.shape.items() if key in ("other", "recording")}
    grid = effect.shapes(model.views[model.fitted[0]][rival.joint or 0])
    step = max(1, len(grid) // _MOST_SHAPES)
    others = [replace(rival, shape={**shape, **chosen}, rebuilt=()) for shape in grid[::step]]
    return [rival, *(term for term in others if term.shape != rival.shape)]


class Question:
    """The rivals in the light of what is recorded; weighs motions."""

    def __init__(
        self,
        model: Model,
        rivals: tuple[Term, ...],
        prior: Prior,
        hydraulic: HydraulicLimits,
        chances: tuple[float, ...] | None,
    ) -> None:
        self.model, self.rivals, self.hydraulic, self.chances = model, rivals, hydraulic, chances
        design = model.design
        families = {rival.family for rival in rivals}
        # Effects that are not in question belong to the base.
        known = [term for term in model.terms if term.family not in families]
        shapes = [_shapes(model, rival) for rival in rivals]
        self.terms = (*known, *(term for own in shapes for term in own))
        widths = [term.width for term in self.terms]
        ends = np.cumsum([len(design.parameters), *widths]).tolist()
        self.fixed = ends[len(known)]
        places = [slice(e - w - self.fixed, e - self.fixed) for e, w in zip(ends[1:], widths, strict=True)]
        rest = iter(places[len(known) :])
        parts = [tuple(next(rest) for _ in own) for own in shapes]
        extra = extra_columns(design, model.views, self.terms)
        rows = whitened(design, model.noise, model.fitted, extra)
        expected = extra.expected_rows(len(design.parameters))
        self.recorded = products((*with_prior(rows, design.parameters, prior), *expected))
        trained = [i for i in model.fitted if design.segments[i].role in ("train", "repeat", "operation")]
        length = sum(len(design.segments[i]) for i in trained) / design.bank.rate_hz
        self.training = products(whitened(design, model.noise, trained, extra)) / length  # per second
        apart = projected(self.recorded, self.fixed)
        self.questioned = [
            Rival(tuple(terms), places, _fitted(apart, rival, places[0]))
            for rival, terms, places in zip(rivals, shapes, parts, strict=True)
        ]
        self._leads = leads(apart[:-1, :-1], self.questioned)
        self.now = self._separation(self.recorded)
        self.chambers = chamber_models(model)
        self.next_recording = 1 + max(segment.recording for segment in design.segments)

    def _separation(self, total: FloatArray) -> Separation:
        then = leads(projected(total, self.fixed)[:-1, :-1], self.questioned)
        return separation(self._leads, then, self.questioned, self.chances)

    @property
    def suspects(self) -> list[int]:
        """Joints to move: those of the rivals; for effects of the whole machine the two that feel them most."""
        named = list(dict.fromkeys(term.joint for term in self.rivals if term.joint is not None))
        if named:
            return named[:2]
        extra = extra_columns(self.model.design, self.model.views, self.terms)
        felt = []
        for rows in whitened(self.model.design, self.model.noise, self.model.fitted, extra):
            own = rows.A[:, self.fixed :]
            felt.append(max(float(np.sum((own[:, r.places[0]] @ r.values) ** 2)) for r in self.questioned))
        return [int(joint) for joint in np.argsort(felt)[::-1][:2]]

    def holding(self, q: FloatArray) -> FloatArray:
        """Compute load forces (N, n) of the fitted arm at rest."""
        design = self.model.design
        values = self.model.fit.theta[design.parameters.base_slice]
        return holding_efforts(design.machine, design.parameters.base, values, q)

    def segment(self, motion: Motion) -> Segment:
        """Make a segment of a motion as it would be recorded."""
        design = self.model.design
        return planned_segment(design.machine, design.bank, design.noise, motion, self.next_recording)

    def segment_of(self, states: States) -> Segment:
        """Make the same from exact states."""
        design = self.model.design
        return segment_of_states(design.machine, design.bank, design.noise, states, self.next_recording)

    def _products(self, segment: Segment) -> FloatArray:
        """Compute what a segment would add to the products."""
        known = self.model.design
        design = build_design(known.machine, known.parameters.base, known.bank, known.noise, [segment])
        like = self.model.views[self.model.fitted[0]][0]
        views = planned_views(design, self.model.fit.theta, self.chambers, self.model.terms, like)
        return products(whitened(design, self.model.noise, [0], extra_columns(design, views, self.terms)))

    def separations(self, segments: Sequence[Segment]) -> list[Separation]:
        """Compute the separation by all data with each of the segments added."""
        return [self._separation(self.recorded + self._products(segment)) for segment in segments]

    def again(self, seconds: float) -> Separation:
        """Compute the separation with ``seconds`` more of the training motions."""
        return self._separation(self.recorded + seconds * self.training)

    def repeated(self, motion: Motion, times: Iterable[int]) -> Iterator[Separation]:
        """Compute separations with a motion recorded so many times each."""
        more = self._products(self.segment(motion))
        return (self._separation(self.recorded + number * more) for number in times)


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
        apart = 100 * np.sqrt(most.expected.worst.share)
        alike = Sentence("fitting.best_motion_cannot_tell", first=first, expected=_differ(most.expected), apart=apart)
        return Sentence("fitting.would_tell", first=alike, by_hand=self.by_hand) if self.by_hand else alike


def term_label(term: Term, joints: Sequence[str]) -> str:
    """Name a term briefly: an effect's id, or the law's variable."""
    content = term.content
    return Sentence("fitting.law_of", variable=content.variable(tuple(joints))) if isinstance(content, Law) else term.id


def _differ(value: Separation) -> str:
    far, share = float(np.sqrt(value.worst.chi_square)), 100 * value.worst.share
    return Sentence("fitting.standard_deviations_effect", standard_deviations=far, share=share)


def _separation_to_json(value: Separation) -> dict[str, float]:
    worst = value.worst
    return {
        "chi_square": worst.chi_square,
        "standard_deviations": float(np.sqrt(worst.chi_square)),
        "own_share": worst.share,
        "needed": 2.0 * worst.asked,  # the lead in chi-square that goes with these odds
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
