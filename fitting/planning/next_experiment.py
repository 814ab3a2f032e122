"""The next experiment, designed: which motion tells rivals apart, and how far.

For every motion of a menu, and for motions searched for the purpose, the separation of the rivals is predicted at the
size that was fitted (:mod:`fitting.planning.separation`): the motion goes through the filters, the rivals' columns are
built on it with the model's own forces, and the base model is projected out together with everything recorded so far.
The best is named with its expected separation, and can be run. Where no motion of this arm separates them, that is
said, and the catalogue's other experiments are given (another load, vented chambers, an inclinometer).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.machine_file import Machine
from fitting.arm.base_parameters import base_regressor
from fitting.arm.linkage import lever_arm
from fitting.effects.base import Effect
from fitting.excitation.experiments import menu
from fitting.excitation.limits import HydraulicLimits, limits_of_machine, limits_used
from fitting.excitation.motion import Motion
from fitting.excitation.series import Series, random_series, varied
from fitting.planning.guess import Guess, worst_friction
from fitting.planning.planned import States, planned_segment, segment_of_states
from fitting.planning.planned_views import chamber_models, planned_views
from fitting.planning.separation import Rival, Separation, leads, products, projected, separation
from fitting.regression.design import build_design, whitened
from fitting.regression.prior import Prior, with_prior
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, extra_columns
from fitting.signals.preparation import Segment

FloatArray = npt.NDArray[np.float64]

#: Chance of a single name from which on an experiment is worth making.
ENOUGH = 0.8
#: Chance of a single name below which a motion is not worth the time of a machine that can be asked at any moment.
_LEAST = 0.05
#: Chi-square between rivals that it has to add: what only the number of their parameters decides needs no motion.
_LEAST_GROWTH = 1.0
#: Repetitions beyond which a motion does not separate the rivals for practical purposes.
MOST_RECORDINGS = 4
_GENERATIONS, _PER_GENERATION = 3, 8
#: Shapes of a rival's grid that are looked at.
_MOST_SHAPES = 16
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
    """What to do next about a set of rivals.

    Attributes
    ----------
    rivals : the terms that the data cannot tell apart, best first
    now : their separation by what is recorded
    options : all experiments that were weighed, best first
    recordings : how often the best one has to be recorded to be enough; None if no motion separates the rivals
    advice : the catalogue's experiments for these effects
    """

    rivals: tuple[Term, ...]
    now: Separation
    options: tuple[Option, ...]
    recordings: int | None
    advice: tuple[str, ...]

    @property
    def best(self) -> Option | None:
        """The experiment to make; None if no motion separates the rivals."""
        return self.options[0] if self.recordings is not None else None

    @property
    def attempt(self) -> Option | None:
        """The best motion for somebody who can record at little cost, also where it may well not be enough.

        None if no motion improves the chance of a single name.
        """
        for option in self.options:
            if option.motion is None or option.expected.probability < _LEAST:
                continue
            pairs = zip(option.expected.pairs, self.now.pairs, strict=True)
            helps = any(then.chi_square - now.chi_square > _LEAST_GROWTH for then, now in pairs)
            return option if helps and option.expected.margin > self.now.margin else None
        return None

    def to_json(self, machine: Machine, motion_file: str | None = None) -> dict[str, Any]:
        """As ``loop.next_experiment`` of the report; ``motion_file`` is where the motion was written."""
        names = [joint.name for joint in machine.joints]
        ids = self._labels(names)
        joint = self.rivals[0].joint
        best = self.best
        return {
            "motion": self._text(),
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
            "otherwise": list(self.advice),
        }

    def _text(self) -> str:
        best = self.best
        if best is None:
            return "; or ".join(self.advice)
        return best.text if self.recordings == 1 else f"{best.text}; record it {self.recordings} times"

    def _labels(self, names: Sequence[str]) -> list[str]:
        return [term_label(term, names) for term in self.rivals]

    def _why(self, names: Sequence[str]) -> str:
        ids = " and ".join(self._labels(names))
        d = self.now.standard_deviations
        first = f"{ids} differ by {d:.1f} standard deviations in these recordings ({_own(self.now)})"
        best = self.best
        if best is None:
            attempt = self.attempt
            if attempt is None:
                most = self.options[0].expected
                return (
                    f"{first}, and by {most.standard_deviations:.1f} ({_own(most)}) with the best motion that this arm "
                    "may make: no motion tells them apart"
                )
            return (
                f"{first}, and by {attempt.expected.standard_deviations:.1f} ({_own(attempt.expected)}) with "
                f"{attempt.text}, which leaves a chance of only {100 * attempt.expected.probability:.0f} % of a "
                "single name"
            )
        return (
            f"{first}; with this experiment once by {best.expected.standard_deviations:.1f} "
            f"({_own(best.expected)}), a {100 * best.expected.probability:.0f} % chance of a single name"
        )


def term_label(term: Term, joints: Sequence[str]) -> str:
    """A term in a word or two: an effect's id, or the law's variable."""
    content = term.content
    return f"law of {content.variable(tuple(joints))}" if isinstance(content, Law) else term.id


def _own(value: Separation) -> str:
    return f"{100 * value.share:.2g} % of the effect are its own"


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
    use: float = 0.92,
    hydraulic: HydraulicLimits | None = None,
    seed: int = 0,
    generations: int = _GENERATIONS,
) -> NextExperiment:
    """Design the experiment that tells rivals apart.

    Parameters
    ----------
    model : the fitted model; if it holds one of the rivals already, that one is taken out first
    rivals : two or more terms that explain the same residual
    prior : what the fit knew beforehand
    chances : that each of them is right; the same for all if None
    seconds, use : length of the motions, and the share of every limit that they may use
    hydraulic : supply flow and chamber pressures; those of the machine file for the fitted parameters if None
    seed, generations : of the search for a motion of its own; 0 generations leave it out

    Raises
    ------
    ValueError
        For fewer than two rivals.
    """
    if len(rivals) < 2:
        raise ValueError("an experiment tells two rivals or more apart")
    question = _Question(model, tuple(rivals), prior, hydraulic or supply_of(model), _normed(chances))
    machine, base = model.design.machine, model.design.parameters.base
    experiments = [
        each
        for joint in question.suspects
        for each in menu(
            machine,
            machine.joints[joint].name,
            seconds=seconds,
            use=use,
            holding=question.holding,
            hydraulic=question.hydraulic,
            base=base,
        )
    ]
    options = [
        Option(each.kind, each.text, each.motion, apart)
        for each, apart in zip(
            experiments, question.separations([question.segment(e.motion) for e in experiments]), strict=True
        )
    ]
    options.append(Option("again", "the training motion once more", None, question.again(seconds)))
    designed = _designed(question, np.random.default_rng(seed), seconds, use, generations)
    if designed is not None:
        options.append(designed)
    options.sort(key=lambda option: -option.expected.margin + (_SIMPLER if option.kind == "designed" else 0.0))
    return NextExperiment(
        tuple(rivals), question.now, tuple(options), question.recordings(options[0], seconds), _advice(rivals)
    )


def supply_of(model: Model) -> HydraulicLimits:
    """Supply flow and chamber pressures of the machine file, with loads and friction as they were fitted."""
    design, theta = model.design, model.fit.theta
    parameters, machine = design.parameters, design.machine
    drive = tuple(theta[parameters.drive_slice(joint)] for joint in range(len(machine.joints)))
    values = theta[parameters.base_slice]
    fitted = Guess(values, drive, np.zeros(len(drive)), "parameters as fitted", measured=True)
    return limits_of_machine(machine, values, worst_friction(machine, fitted))


def _advice(rivals: Sequence[Term]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(t.content.experiment for t in rivals if isinstance(t.content, Effect)))


def _normed(chances: Sequence[float] | None) -> tuple[float, ...] | None:
    """Chances that add up to one, none of them nothing."""
    if chances is None:
        return None
    shares = np.maximum(np.asarray(chances, dtype=float), 1e-3)
    return tuple((shares / shares.sum()).tolist())


def _fitted(apart: FloatArray, rival: Term, place: slice) -> FloatArray:
    """Values of a rival fitted without the others; what was moved into the signals is put back first."""
    S, target = apart[:-1, :-1], apart[:-1, -1]
    if rival.rebuilt:
        target = target + S[:, place] @ np.asarray(rival.rebuilt)
    return np.asarray(np.linalg.pinv(S[place, place], rcond=1e-8, hermitian=True) @ target[place])


def _shapes(model: Model, rival: Term) -> list[Term]:
    """A rival in its fitted shape, and in others of its grid: a wrong one adapts itself to a new recording."""
    effect = rival.content
    if not isinstance(effect, Effect):
        return [rival]
    chosen = {key: value for key, value in rival.shape.items() if key in ("other", "recording")}
    grid = effect.shapes(model.views[model.fitted[0]][rival.joint or 0])
    step = max(1, len(grid) // _MOST_SHAPES)
    others = [replace(rival, shape={**shape, **chosen}, rebuilt=()) for shape in grid[::step]]
    return [rival, *(term for term in others if term.shape != rival.shape)]


class _Question:
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
        widths = [len(term.names(design.parameters.joints)) for term in self.terms]
        ends = np.cumsum([len(design.parameters), *widths]).tolist()
        self.fixed = ends[len(known)]
        places = [slice(e - w - self.fixed, e - self.fixed) for e, w in zip(ends[1:], widths, strict=True)]
        rest = iter(places[len(known) :])
        parts = [tuple(next(rest) for _ in own) for own in shapes]
        extra = extra_columns(design, model.views, self.terms)
        rows = whitened(design, model.noise, model.fitted, extra)
        self.recorded = products(with_prior(rows, design.parameters, prior))
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
        """Load forces (N, n) of the fitted arm at rest."""
        design = self.model.design
        still = np.zeros_like(q)
        values = self.model.fit.theta[design.parameters.base_slice]
        tau = base_regressor(design.machine, design.parameters.base, q, still, still) @ values
        levers = [
            np.ones(len(q)) if joint.cylinder is None else lever_arm(joint.cylinder.linkage, q[:, j])
            for j, joint in enumerate(design.machine.joints)
        ]
        return np.asarray(tau / np.column_stack(levers))

    def segment(self, motion: Motion) -> Segment:
        """A motion as it would be recorded."""
        design = self.model.design
        return planned_segment(design.machine, design.bank, design.noise, motion, self.next_recording)

    def segment_of(self, states: States) -> Segment:
        """The same from exact states."""
        design = self.model.design
        return segment_of_states(design.machine, design.bank, design.noise, states, self.next_recording)

    def gathered(self, segments: Sequence[Segment]) -> list[FloatArray]:
        """What each segment would add to the products."""
        known = self.model.design
        design = build_design(known.machine, known.parameters.base, known.bank, known.noise, segments)
        like = self.model.views[self.model.fitted[0]][0]
        views = planned_views(design, self.model.fit.theta, self.chambers, self.model.terms, like)
        extra = extra_columns(design, views, self.terms)
        return [products(whitened(design, self.model.noise, [index], extra)) for index in range(len(segments))]

    def separations(self, segments: Sequence[Segment]) -> list[Separation]:
        """Separation by all data with each of the segments added."""
        return [self._separation(self.recorded + more) for more in self.gathered(segments)] if segments else []

    def again(self, seconds: float) -> Separation:
        """Separation with ``seconds`` more of the training motions."""
        return self._separation(self.recorded + seconds * self.training)

    def recordings(self, option: Option, seconds: float) -> int | None:
        """How often an experiment has to be recorded to be enough; None if more often than is sensible."""
        if option.expected.probability >= ENOUGH:
            return 1
        more = None if option.motion is None else self.gathered([self.segment(option.motion)])[0]
        for times in range(2, MOST_RECORDINGS + 1):
            found = self.again(times * seconds) if more is None else self._separation(self.recorded + times * more)
            if found.probability >= ENOUGH:
                return times
        return None


def _designed(
    question: _Question, rng: np.random.Generator, seconds: float, use: float, generations: int
) -> Option | None:
    """A motion of all joints that was searched for the separation itself: random series, the best of them varied.

    None if none of them is inside the limits.
    """
    machine = question.model.design.machine
    pool: list[tuple[Separation, Series]] = []
    for generation in range(generations):
        if not pool:
            trials = [random_series(machine, seconds, rng, question.suspects) for _ in range(2 * _PER_GENERATION)]
        else:
            trials = [varied(pool[k % min(3, len(pool))][1], rng, 0.5 / generation) for k in range(_PER_GENERATION)]
        allowed = [series for trial in trials if (series := _allowed(question, trial, use)) is not None]
        segments = [question.segment_of(series.states(machine, use)) for series in allowed]
        pool += zip(question.separations(segments), allowed, strict=True)
        pool.sort(key=lambda entry: -entry[0].margin)
    if not pool:
        return None
    motion = pool[0][1].motion(machine, use)
    expected = question.separations([question.segment(motion)])[0]
    return Option("designed", "a motion of all joints that was designed to tell them apart", motion, expected)


def _allowed(question: _Question, series: Series, use: float) -> Series | None:
    """The series inside all limits: shrunk about its home, and its home towards the middle; None if that is no use."""
    limits = question.hydraulic
    if limits.flow is None and limits.pressure is None:
        return series
    machine, base = question.model.design.machine, question.model.design.parameters.base
    for _ in range(_SHRINKS):
        used = limits_used(machine, limits, *series.states(machine, use), base)
        if all(each.used <= use for each in used if each.quantity in ("flow", "pressure")):
            return series
        series = replace(series, amplitude=0.85 * series.amplitude, home=0.85 * series.home)
    return None
