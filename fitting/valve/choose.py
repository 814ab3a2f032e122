"""Which law of the pressure, which curve, which effect: what another motion says.

In sample a law without pressure may win and lose elsewhere, so candidates are compared by the log predictive density
of rows that were not fitted: recordings are left out one after another (stretches of a single one), the parameters
moved by one step of Gauss and Newton without them. A residual hangs together, so its rows count for as many as its
autoregression leaves independent. With the prior of :mod:`fitting.selection.priors` that makes a probability for each
candidate and for nothing; something is said from 0.95 on, and names within reach of the best are said as a set.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.arrays import BoolArray, FloatArray
from fitting.estimators.covariance import autoregression
from fitting.selection import priors
from fitting.selection.evidence import log_sum
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit, fitted
from fitting.valve.laws import LAWS, laws_for
from fitting.valve.model import WAYS, Shape, Structure
from fitting.valve.rows import Axis

#: Parts that a single recording, or many, are left out in.
FOLDS = 5
#: Share by which the error on rows that were left out has to fall: below that nobody changes a valve.
WORTH = 0.02
#: What has to be seen of an effect, as RMS over that of the speed.
VISIBLE = 0.003
#: Errors whose ratio is below this are alike where two effects are known for their likeness.
ALIKE = 1.25
#: Samples by which shapes can be told from one another.
ENOUGH = 12_000
#: Log odds by which a law, or a curve, has to be better than a simpler one.
LAW_ODDS = 1.0
CURVES = {"power": "a curve with an exponent", "monotone": "a curve in pieces (a spool that saturates)"}


@dataclass(frozen=True)
class Candidate:
    """Something more that was tried.

    Attributes
    ----------
    id, title : of the effect, or of the curve
    fit : the model with it
    odds : log predictive density over that without it, on rows that were left out
    error, before : RMS of the error over that of the speed on those rows, with it and without
    probability : of this one, given that one of all tried or nothing is right
    """

    id: str
    title: str
    fit: Fit
    odds: float
    error: float
    before: float
    confirmed: bool
    probability: float = 0.0


@dataclass(frozen=True)
class Chosen:
    """A model that was chosen.

    Attributes
    ----------
    base, fit : without and with what was found
    laws : error on rows left out of each law that was tried, by direction and law
    steps : candidates of each round, the best first
    found : what was added
    sets : of each of ``found`` the ids that cannot be told from it
    """

    base: Fit
    fit: Fit
    laws: dict[str, dict[str, float]]
    steps: tuple[tuple[Candidate, ...], ...]
    found: tuple[Candidate, ...]
    sets: tuple[tuple[str, ...], ...]


def folds_of(axis: Axis) -> list[BoolArray]:
    """Rows (M,) of each part that is left out in turn: recordings, or stretches of time where there is one only."""
    numbers = np.unique(axis.recordings)
    if len(numbers) > 1:
        parts = np.array_split(numbers, min(FOLDS, len(numbers)))
        return [np.isin(axis.recordings, part) for part in parts]
    place = np.arange(len(axis.keep))
    return [np.isin(place, part) for part in np.array_split(place, FOLDS)]


def left_out(fit: Fit) -> FloatArray:
    """Error (M,) of each row as it would be without its fold in the fit."""
    names, J = fit.jacobian
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-30)
    scaled, out = J / size, fit.residual.copy()
    for fold in folds_of(fit.axis):
        rest = scaled[~fold]
        gram = rest.T @ rest + 1e-6 * np.eye(len(names))
        step = np.linalg.solve(gram, rest.T @ fit.residual[~fold])
        out[fold] = fit.residual[fold] - scaled[fold] @ step
    return out


def independent_rows(fit: Fit, residual: FloatArray) -> float:
    """How many independent values the kept rows of a residual (M,) count for."""
    e = residual[fit.axis.keep]
    taps = autoregression(e)
    white = np.convolve(e, taps, mode="valid")
    long_run = float(np.mean(white**2)) / float(np.sum(taps)) ** 2
    return len(e) / max(long_run / max(float(np.mean(e**2)), 1e-30), 1.0)


def compared(before: Fit, after: Fit) -> tuple[float, float, float, bool]:
    """Log predictive density gained, errors with and without, and whether most folds agree."""
    one, other = left_out(before), left_out(after)
    keep = before.axis.keep
    squares = [float(np.sum(own[keep] ** 2)) for own in (one, other)]
    odds = 0.5 * independent_rows(before, one) * float(np.log(squares[0] / max(squares[1], 1e-30)))
    folds = [fold & keep for fold in folds_of(before.axis)]
    better = [np.sum(one[fold] ** 2) > np.sum(other[fold] ** 2) for fold in folds if fold.any()]
    power = float(np.sum(before.axis.speed[keep] ** 2))
    return odds, float(np.sqrt(squares[1] / power)), float(np.sqrt(squares[0] / power)), bool(np.mean(better) > 0.6)


def chosen(axis: Axis, *, loop: bool = True) -> Chosen:
    """The model of an axis: its laws of the pressure and, with the ``loop``, its curve and effects."""
    base, laws = _with_laws(axis, fitted(axis, Structure(stiffness=axis.has_pressures)))
    if loop:  # a land that is no straight line bends the edges, and looks like a law that it has not
        curved = _curve(base, "power")
        if curved.confirmed and curved.odds > 2 * LAW_ODDS and curved.error < (1.0 - WORTH) * curved.before:
            base, laws = _with_laws(axis, curved.fit)
    fit, steps, found, sets, said = base, [], [], [], set[str]()
    for _ in range(priors.MOST if loop else 0):
        tried = _candidates(fit)
        steps.append(tuple(tried))
        if not tried or tried[0].probability < 0.5:
            break
        best = tried[0]
        near = [c for c in tried[1:] if c.confirmed and _alike(best, c) and c.id not in said]
        together = best.probability + sum(c.probability for c in near)
        seen = np.sqrt(max(best.before**2 - best.error**2, 0.0))
        if together < priors.SAID or best.error > (1.0 - WORTH) * best.before or seen < VISIBLE or best.id in said:
            break
        fit, laws = _with_laws(axis, best.fit)
        found.append(best)
        sets.append(tuple(c.id for c in near[:2]))
        said |= {best.id, *sets[-1]}
    return Chosen(base, fit, laws, tuple(steps), tuple(found), tuple(sets))


def _alike(best: Candidate, other: Candidate) -> bool:
    """Whether one cannot be told from the best: nearly as probable, or known to be like it and nearly as good."""
    known = best.id in EFFECTS and other.id in EFFECTS[best.id].confounders
    return other.odds > best.odds - priors.SAID_ODDS or (known and other.error < ALIKE * best.error)


def _with_laws(axis: Axis, fit: Fit) -> tuple[Fit, dict[str, dict[str, float]]]:
    """The law of each direction, one after the other and the first once more."""
    ids = laws_for(pressures=axis.has_pressures, supply=axis.has_supply, compensated=axis.valve.compensated)
    tried: dict[str, dict[str, float]] = {way: {} for way in WAYS}
    if len(ids) < 2:
        return fit, tried
    for way in (0, 1, 0):
        simple = replace_law(fit, way, "none")
        best, gained = simple, 0.0
        tried[WAYS[way]]["none"] = _error(simple)
        for own in ids[1:]:
            trial = replace_law(fit, way, own)
            odds, error, before, _ = compared(simple, trial)
            tried[WAYS[way]][own] = error
            odds -= LAW_ODDS * (1 + len(LAWS[own].shape))
            worth = not LAWS[own].shape or error < (1.0 - WORTH) * before  # an exponent has to be earned
            if odds > gained and worth:
                best, gained = trial, odds
        fit = best
    return fit, tried


def replace_law(fit: Fit, way: int, law: str) -> Fit:
    """The model with another law in one direction, refined from where it stands."""
    structure = fit.structure.with_law(way, law)
    return fit if structure == fit.structure else fitted(fit.axis, structure, _kept(fit, structure))


def _kept(fit: Fit, structure: Structure) -> Shape:
    """What a shape has in common with another structure's."""
    return {name: value for name, value in fit.shape.items() if name in structure.shape()}


def _error(fit: Fit) -> float:
    keep = fit.axis.keep
    return float(np.sqrt(np.sum(left_out(fit)[keep] ** 2) / np.sum(fit.axis.speed[keep] ** 2)))


def _candidates(fit: Fit) -> list[Candidate]:
    """Everything that could be added, with its probability, the best first."""
    tried = [*_effects(fit), *_curves(fit)]
    if not tried:
        return []
    catalogue = np.log(priors.CATALOGUE / max(len(EFFECTS), 1))
    other = np.log(priors.UNKNOWN / len(CURVES))
    logs = [c.odds + (catalogue if c.id in EFFECTS else other) if c.confirmed else -np.inf for c in tried]
    total = float(log_sum(np.array([*logs, np.log(priors.NOTHING)])))
    rated = [replace(c, probability=float(np.exp(own - total))) for c, own in zip(tried, logs, strict=True)]
    return sorted(rated, key=lambda c: (-c.probability, -c.odds))


def _effects(fit: Fit) -> Iterable[Candidate]:
    structure = fit.structure
    for effect in EFFECTS.values():
        if effect.id in structure.effects or not effect.applies(fit.axis, structure.laws):
            continue
        trials = [structure.with_effect(effect.id)]
        beside = effect.beside(fit.axis)
        if beside is not None and beside != structure.laws:
            trials.append(replace(trials[0], laws=beside))
        yield _best(effect.id, effect.title, fit, trials, effect.starts_of(fit.axis))


def _curves(fit: Fit) -> Iterable[Candidate]:
    if fit.structure.curve == "line" and "pump_flow_limit" not in fit.structure.effects:
        yield from (_curve(fit, curve) for curve in CURVES)


def _curve(fit: Fit, curve: str) -> Candidate:
    starts: tuple[Shape, ...] = ({}, {"power.extend": 1.5, "power.retract": 1.5}) if curve == "power" else ({},)
    return _best(f"curve_{curve}", CURVES[curve], fit, [replace(fit.structure, curve=curve)], starts)


def _best(own: str, title: str, before: Fit, structures: Sequence[Structure], starts: Sequence[Shape]) -> Candidate:
    """The best of a candidate's shapes, begun with the delay and the edges anew, and from where they stand.

    Begun on a part of what was recorded; what comes out best is refined on all of it.
    """
    axis = _part(before.axis)
    trials = []
    for structure in structures:
        trials += [fitted(axis, structure, start, iterations=8) for start in starts if start]
        trials += [fitted(axis, structure, {**_kept(before, structure), **start}, iterations=8) for start in starts]
    best = min(trials, key=lambda f: f.misfit)
    whole = fitted(before.axis, best.structure, best.shape)
    odds, error, was, confirmed = compared(before, whole)
    return Candidate(own, title, whole, odds, error, was, confirmed)


def _part(axis: Axis) -> Axis:
    """Recordings of an axis, evenly taken, of as many samples as shapes are told by."""
    numbers = np.unique(axis.signals.recording)
    share = max(1, int(np.ceil(len(axis.signals) / ENOUGH)))
    return axis if share == 1 or len(numbers) < 2 else axis.of(numbers[::share].tolist())
