"""Choice of the law of the pressure, the curve and the effects, on another motion.

In sample a law without pressure may win and lose elsewhere, so candidates are compared by the log predictive density
of rows that were not fitted (:mod:`fitting.residual.confirmation.local`). With the prior of
:mod:`fitting.selection.priors` that makes a probability for each candidate and for nothing; something is reported from
0.95 on, and names within reach of the best are reported as a set. Nothing is chosen by the motion that is judged on: it
may refuse, by the rule of the gate.

Names are compared with laws of one variable ``z``: a speed that is wrong by a share that follows it is, to first order,
``(1 + h(z))`` times what the valve lets through, with ``h`` any smooth curve, as the loop's laws are. Nature is off a
formula by a share; so a law that takes no more beyond a name than that share of what the name takes is the name's own.

Laws of the pressure are chosen beside the widest curve there is: a land that is no straight line bends the edges, and
looks like a law that it has not.

Source: S. Geisser and W. Eddy, J. Am. Stat. Assoc. 74, 1979 (predictive density of what is left out).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.messages import Sentence
from fitting.arrays import BoolArray, FloatArray
from fitting.residual.confirmation import cross_validation as gate
from fitting.residual.confirmation.local import Local, beside, elsewhere
from fitting.residual.laws import OTHER_FUNCTIONS
from fitting.selection import priors
from fitting.selection.confirm import objection
from fitting.selection.evidence import log_sum, with_curve
from fitting.signals.splines import evaluate, spline_knots
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit, fitted
from fitting.valve.laws import LAWS, laws_for
from fitting.valve.model import WAYS, Shape, Structure
from fitting.valve.rows import Axis

#: Parts that a single recording, or many, are left out in.
FOLDS = 5
#: Share by which the error on rows that were left out has to fall: less is not worth a change of the valve.
WORTH = 0.02
#: What has to be seen of an effect, as RMS over that of the speed.
VISIBLE = 0.003
#: Errors whose ratio is below this are alike where two effects are known for their likeness.
ALIKE = 1.25
#: Samples by which shapes can be separated from one another.
ENOUGH = 12_000
#: Log odds by which a law, or a curve, has to be better than a simpler one.
LAW_ODDS = 1.0


def _filled(axis: Axis) -> FloatArray:
    """Compute the drop in Pa (N,) that feeds the cylinder, or without known supply the fed pressure."""
    filled = np.where(axis.signals.last_way < 0.0, axis.signals.inlet[1], axis.signals.inlet[0])
    return np.asarray(axis.signals.supply - filled if axis.has_supply else filled)


#: Name of a variable, its unit, and the variable (N,) itself; what is not measured is not finite.
VARIABLES: dict[str, tuple[str, Callable[[Axis], FloatArray]]] = {
    "inlet_pressure": ("Pa", _filled),
    "piston_position": ("m", lambda axis: axis.signals.x),
    "oil_temperature": ("K", lambda axis: axis.signals.temperature),
    "time": ("s", lambda axis: axis.signals.clock),
    "neighbours_flow": ("m^3/s", lambda axis: axis.signals.taken),
}


@dataclass(frozen=True)
class Unknown:
    """A law beside a fit.

    Attributes
    ----------
    variable : what it follows
    local : the fit's columns with the curve's behind them
    values : (p,) what all of them are moved by
    knots : of the curve
    """

    variable: str
    local: Local
    values: FloatArray
    knots: FloatArray

    def on(self, there: Fit, moved: Local) -> Local:
        """Refit on another motion: what is left, and its columns there, from those of the fit (:meth:`Fit.on`)."""
        whole = np.hstack([moved.columns, _columns(there, self.variable, self.knots)])
        return replace(self.local, columns=whole, residual=there.residual - whole @ self.values, rows=moved.rows)

    def to_json(self, points: int = 21) -> dict[str, Any]:
        """Return its report: the curve as shares of the speed, with standard deviations, over the variable."""
        first = len(self.values) - (len(self.knots) - 4)
        grid = np.linspace(self.knots[0], self.knots[-1], points)
        basis = evaluate(self.knots, grid)
        std = np.sqrt(np.einsum("ij,jk,ik->i", basis, self.local.covariance[first:, first:], basis))
        value = basis @ self.values[first:]
        law = {"grid": grid.tolist(), "value": value.tolist(), "std": std.tolist(), "unit": VARIABLES[self.variable][0]}
        return {
            "variable": self.variable,
            "law": law,
            "experiment": Sentence("fitting.same_commands_different_values"),
        }


def _columns(fit: Fit, variable: str, knots: FloatArray) -> FloatArray:
    """Compute each coefficient's unit speed (M, functions); 0 in rows left out."""
    axis, basis = fit.axis, evaluate(knots, VARIABLES[variable][1](fit.axis))
    return np.where(axis.keep[:, None], axis.reduced(fit.openings[:, None] * basis), 0.0)


def _unknown_laws(fit: Fit) -> Iterator[Unknown]:
    """Fit the most probable curve of every measured variable that changed in motion."""
    base, moving = fit.local, fit.openings != 0.0
    for variable, (_, of) in VARIABLES.items():
        z = of(fit.axis)[moving]
        if len(z) and np.isfinite(z).all() and np.ptp(z) > 1e-9 * float(np.abs(z).max()):
            knots = spline_knots(z, OTHER_FUNCTIONS)
            local, values = with_curve(base, _columns(fit, variable, knots))
            rows = replace(fit, residual=local.residual).rows
            yield Unknown(variable, replace(local, rows=rows), values, knots)


@dataclass(frozen=True)
class Candidate:
    """Something more that was tried.

    Attributes
    ----------
    id, title : of the effect, or of the variable that a law follows
    fit : the model with it; without it where it is a law
    odds : log predictive density over that without it, on rows that were left out
    error, before : RMS of the error over that of the speed on those rows, with it and without
    reason : what speaks against it; empty if nothing does
    refused : whether that is the motion that is judged on
    law : where it is one
    probability : of this one, given that one of all tried or nothing is right
    """

    id: str
    title: str
    fit: Fit
    odds: float
    error: float
    before: float
    reason: str
    refused: bool
    law: Unknown | None = None
    probability: float = 0.0


@dataclass(frozen=True)
class Chosen:
    """A model that was chosen.

    Attributes
    ----------
    fits : without anything, and with each of ``found`` one after the other
    laws : error on rows left out of each law that was tried, by direction and law
    steps : candidates of each round, the best first
    found : what was added
    sets : of each of ``found``, and of ``unknown``, the ids that cannot be separated from it
    unknown : the law that is reported where no name fits what is left; it is not added
    """

    fits: tuple[Fit, ...]
    laws: dict[str, dict[str, float]]
    steps: tuple[tuple[Candidate, ...], ...]
    found: tuple[Candidate, ...]
    sets: tuple[tuple[str, ...], ...]
    unknown: Candidate | None = None

    @property
    def refused(self) -> bool:
        """True where the judging motion contradicts what held everywhere else and was worth reporting."""
        known, tried = {own.id for own in self.found}, [own for step in self.steps for own in step]
        return any(own.refused and _worth(own.before, own.error) for own in tried if own.id not in known)


def _folds_of(axis: Axis) -> list[BoolArray]:
    """Return rows (M,) of each part left out in turn: recordings, or stretches of time of a single one."""
    numbers = np.unique(axis.recordings)
    if len(numbers) > 1:
        parts = np.array_split(numbers, min(FOLDS, len(numbers)))
        return [np.isin(axis.recordings, part) for part in parts]
    place = np.arange(len(axis.keep))
    return [np.isin(place, part) for part in np.array_split(place, FOLDS)]


def _compared(axis: Axis, before: Local, after: Local) -> tuple[gate.HeldOut, float, float]:
    """Compare a model with a simpler one on held-out rows; errors over the speed's RMS with it, without.

    Whether it hangs on one part only is asked of the gate's blocks: few recordings move one axis.
    """
    block = np.arange(len(axis.keep)) // round(gate.BLOCK_SECONDS * axis.bank.reduced_rate_hz) % gate.FOLDS
    held, *squares = beside(before, after, _folds_of(axis), [block == number for number in np.unique(block)])
    error, was = np.sqrt(np.array(squares) / float(np.sum(axis.speed[axis.keep] ** 2))).tolist()
    return held, error, was


def _worth(before: float, after: float) -> bool:
    """Return whether an error's reduction (of the speed's RMS) is worth reporting."""
    return after <= (1.0 - WORTH) * before and before**2 - after**2 >= VISIBLE**2


def chosen(axis: Axis, judged: Axis | None = None, *, loop: bool = True) -> Chosen:
    """Choose an axis' model: its pressure laws and curve; with the ``loop`` its effects.

    Nothing is chosen on the motion that is ``judged`` on: it only rejects.
    """
    wide = fitted(axis, Structure(curve="monotone", stiffness=axis.has_pressures))
    wide, laws = _with_laws(axis, wide)
    fits, steps, reported = [_curved(wide)], list[tuple[Candidate, ...]](), set[str]()
    found, sets = list[Candidate](), list[tuple[str, ...]]()
    for _ in range(priors.MOST if loop else 0):
        named = sum(c.before**2 - c.error**2 for c in found)
        tried = _candidates(fits[-1], judged, named)
        steps.append(tuple(tried))
        if not tried or tried[0].probability < 0.5:
            break
        best = tried[0]
        near = [c for c in tried[1:] if not c.reason and _alike(best, c) and c.id not in reported]
        together = best.probability + sum(c.probability for c in near)
        if together < priors.CREDIBLE or not _worth(best.before, best.error) or best.id in reported:
            break
        sets.append(tuple(c.id for c in near[:2]))
        if best.law is not None:
            return Chosen(tuple(fits), laws, tuple(steps), tuple(found), tuple(sets), best)
        fit, laws = _with_laws(axis, best.fit)
        fits.append(_curved(fit))
        found.append(best)
        reported |= {best.id, *sets[-1]}
    return Chosen(tuple(fits), laws, tuple(steps), tuple(found), tuple(sets))


def _curved(fit: Fit) -> Fit:
    """Choose a line, an exponent where it is earned, or a free curve (a spool that levels out)."""
    shapes = (replace(fit.structure, curve=curve) for curve in ("line", "power", "monotone"))
    best, *others = (fitted(fit.axis, own, _kept(fit, own)) for own in shapes)
    for trial in others:
        held, error, before = _compared(fit.axis, best.local, trial.local)
        if 0.5 * held.gain > 2 * LAW_ODDS and held.alike > 0.0 and _worth(before, error):
            best = trial
    return best


def _alike(best: Candidate, other: Candidate) -> bool:
    """Return whether one is as good as the best: nearly as probable, or akin to it and nearly as good."""
    known = best.law is None and other.id in EFFECTS[best.id].confounders
    return other.odds > best.odds - priors.CREDIBLE_ODDS or (known and other.error < ALIKE * best.error)


def _with_laws(axis: Axis, fit: Fit) -> tuple[Fit, dict[str, dict[str, float]]]:
    """Choose each direction's law, one after the other and the first once more."""
    ids = laws_for(pressures=axis.has_pressures, supply=axis.has_supply, compensated=axis.valve.compensated)
    tried: dict[str, dict[str, float]] = {way: {} for way in WAYS}
    declared = axis.valve.compensated is True  # what the file states has nothing to earn
    if len(ids) < 2:
        return fit, tried
    for way in (0, 1, 0):
        simple = _replace_law(fit, way, "none")
        best, gained, least = simple, 0.0, np.inf
        for own in ids[1:]:
            trial = _replace_law(fit, way, own)
            held, error, before = _compared(axis, simple.local, trial.local)
            tried[WAYS[way]] |= {"none": before, own: error}
            least = min(least, before)
            odds = 0.5 * held.gain - LAW_ODDS * (1 + len(LAWS[own].shape))
            earned = declared or not LAWS[own].shape or _worth(least, error)  # a number, beside the best without one
            if odds > gained and earned:
                best, gained, least = trial, odds, error
        fit = best
    return fit, tried


def _replace_law(fit: Fit, way: int, law: str) -> Fit:
    """Set another law in one direction, refined from the present values."""
    extend, retract = fit.structure.laws
    structure = replace(fit.structure, laws=(law, retract) if way == 0 else (extend, law))
    return fit if structure == fit.structure else fitted(fit.axis, structure, _kept(fit, structure))


def _kept(fit: Fit, structure: Structure) -> Shape:
    """Keep what a shape has in common with another structure's."""
    return {name: value for name, value in fit.shape.items() if name in structure.shape()}


def _candidates(fit: Fit, judged: Axis | None, named: float) -> list[Candidate]:
    """List everything that could be added, with its probability, the best first.

    ``named`` is what names that were found took of the error, squared: what they are off by is no other effect.
    """
    base, axis = fit.local, fit.axis
    here = None if judged is None else fit.on(judged)

    def candidate(own: str, title: str, other: Fit, law: Unknown | None = None) -> Candidate:
        after, refused = other.local if law is None else law.local, ""
        held, error, was = _compared(axis, base, after)
        reason = objection(held, None)
        if judged is not None and here is not None and not reason:
            there = other.on(judged)[1] if law is None else law.on(*here)
            reason = refused = objection(held, elsewhere((base, here[1]), (after, there)))
        return Candidate(own, title, other, 0.5 * held.gain, error, was, reason, bool(refused), law)

    left = (own for own in EFFECTS.values() if own.id not in fit.structure.effects and own.applies(fit.axis))
    with_it = {own: replace(fit.structure, effects=(*fit.structure.effects, own.id)) for own in left}
    tried = [candidate(own.id, own.title, _best(fit, structure, own.starts)) for own, structure in with_it.items()]
    laws = [
        candidate(own.variable, Sentence("fitting.gain_follows", variable=own.variable), fit, own)
        for own in _unknown_laws(fit)
    ]
    names = [(named + c.before**2 - c.error**2, c.error) for c in tried if c.refused or not c.reason]
    names += [(named, c.before) for c in laws[:1]]
    off = max(priors.EPSILONS) ** 2
    tried += [c for c in laws if all(error**2 - c.error**2 > off * took for took, error in names)]
    if not tried:
        return []
    catalogue, other = np.log(priors.CATALOGUE / len(EFFECTS)), np.log(priors.UNKNOWN / max(len(laws), 1))
    logs = [-np.inf if c.reason else c.odds + (catalogue if c.law is None else other) for c in tried]
    total = float(log_sum(np.array([*logs, np.log(priors.NOTHING)])))
    rated = [replace(c, probability=float(np.exp(own - total))) for c, own in zip(tried, logs, strict=True)]
    return sorted(rated, key=lambda c: (-c.probability, -c.odds))


def _best(before: Fit, structure: Structure, starts: Sequence[Shape]) -> Fit:
    """Choose the best of a candidate's shapes, from new and from present delay and edges.

    Begun on a part of what was recorded; what comes out best is refined on all of it.
    """
    axis = _part(before.axis)
    spool = {name: before.shape[name] for name in ("lag", "damping")}
    trials = [fitted(axis, structure, {**spool, **start}, iterations=8) for start in starts if start]
    trials += [fitted(axis, structure, {**_kept(before, structure), **start}, iterations=8) for start in starts]
    best = min(trials, key=lambda f: f.misfit)
    return fitted(before.axis, best.structure, best.shape)


def _part(axis: Axis) -> Axis:
    """Thin an axis' recordings evenly to as many samples as shapes need."""
    numbers = np.unique(axis.signals.recording)
    share = max(1, int(np.ceil(len(axis.signals) / ENOUGH)))
    return axis if share == 1 or len(numbers) < 2 else axis.of(numbers[::share].tolist())
