"""Which law of the pressure, which curve, which effect: what another motion says.

In sample a law without pressure may win and lose elsewhere, so candidates are compared by the log predictive density
of rows that were not fitted: recordings (stretches of a single one) are left out one after another. Of a model that is
linear about its optimum, with residual ``r``, columns ``J`` and information ``G`` of what is left, a part has

    log p = -1/2 (r'r + r'J G^-1 J'r) / s^2 - 1/2 log det(I + J G^-1 J')

so what only the part itself could have told is not held against a model, and pays for being open instead. A residual
hangs together, so its rows count for as many as its autoregression leaves independent. With the prior of
:mod:`fitting.selection.priors` that makes a probability for each candidate and for nothing; something is said from 0.95
on, and names within reach of the best are said as a set.

Laws are chosen beside the widest curve there is: a land that is no straight line bends the edges, and looks like a law
that it has not.

Source: S. Geisser and W. Eddy, J. Am. Stat. Assoc. 74, 1979 (predictive density of what is left out).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.arrays import BoolArray, FloatArray
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
#: A candidate that is no effect: id and title.
FREE = ("curve_monotone", "a free curve (a spool that levels out)")


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
    fits : without anything, and with each of ``found`` one after the other
    laws : error on rows left out of each law that was tried, by direction and law
    steps : candidates of each round, the best first
    found : what was added
    sets : of each of ``found`` the ids that cannot be told from it
    """

    fits: tuple[Fit, ...]
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


def left_out(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Of each part left out the sum of squares and the log determinant (folds,) of the module's text."""
    names, J, _, noise = fit.scaled
    known = J.T @ J + noise * np.eye(len(names))
    squares, open_ones = [], []
    for fold in folds_of(fit.axis):
        own, r = J[fold], fit.residual[fold]
        rest, told = known - own.T @ own, own.T @ r
        squares.append(float(r @ r + told @ np.linalg.solve(rest, told)))
        open_ones.append(np.linalg.slogdet(known)[1] - np.linalg.slogdet(rest)[1])
    return np.array(squares), np.array(open_ones)


def compared(before: Fit, after: Fit) -> tuple[float, float, float, bool]:
    """Log predictive density gained, errors with and without, and whether it does not hang on a single part."""
    rows, (was, one), (now, other) = before.rows, left_out(before), left_out(after)
    total = max(float(now.sum()), 1e-30)
    odds = 0.5 * rows * float(np.log(was.sum() / total)) + 0.5 * float(np.sum(one - other))
    parts = 0.5 * rows * (was - now) / total + 0.5 * (one - other)
    power = float(np.sum(before.axis.speed[before.axis.keep] ** 2))
    errors = float(np.sqrt(total / power)), float(np.sqrt(was.sum() / power))
    return odds, *errors, bool(parts.sum() > parts.max())


def worth(before: float, after: float) -> bool:
    """Whether what takes an error (of the speed's RMS) down is worth being said."""
    return after <= (1.0 - WORTH) * before and before**2 - after**2 >= VISIBLE**2


def chosen(axis: Axis, *, loop: bool = True) -> Chosen:
    """The model of an axis: its laws of the pressure and its curve; with the ``loop`` its effects."""
    wide = fitted(axis, Structure(curve="monotone", stiffness=axis.has_pressures))
    wide, laws = _with_laws(axis, wide)
    fits, steps, found, sets, said = [_curved(wide)], [], [], [], set[str]()
    for _ in range(priors.MOST if loop else 0):
        tried = _candidates(fits[-1])
        steps.append(tuple(tried))
        if not tried or tried[0].probability < 0.5:
            break
        best = tried[0]
        near = [c for c in tried[1:] if c.confirmed and _alike(best, c) and c.id not in said]
        together = best.probability + sum(c.probability for c in near)
        if together < priors.SAID or not worth(best.before, best.error) or best.id in said:
            break
        fit, laws = _with_laws(axis, best.fit)
        fits.append(fit)
        found.append(best)
        sets.append(tuple(c.id for c in near[:2]))
        said |= {best.id, *sets[-1]}
    return Chosen(tuple(fits), laws, tuple(steps), tuple(found), tuple(sets))


def _curved(wide: Fit) -> Fit:
    """A line, or an exponent where it is earned, with the laws that were chosen beside the widest curve."""
    line, power = (replace(wide.structure, curve=curve) for curve in ("line", "power"))
    simple, bent = (fitted(wide.axis, own, _kept(wide, own)) for own in (line, power))
    odds, error, before, confirmed = compared(simple, bent)
    return bent if confirmed and odds > 2 * LAW_ODDS and worth(before, error) else simple


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
        best, gained, least = simple, 0.0, np.inf
        for own in ids[1:]:
            trial = replace_law(fit, way, own)
            odds, error, before, _ = compared(simple, trial)
            tried[WAYS[way]] |= {"none": before, own: error}
            least = min(least, before)
            odds -= LAW_ODDS * (1 + len(LAWS[own].shape))
            earned = not LAWS[own].shape or worth(least, error)  # a number, beside the best that has none
            if odds > gained and earned:
                best, gained, least = trial, odds, error
        fit = best
    return fit, tried


def replace_law(fit: Fit, way: int, law: str) -> Fit:
    """The model with another law in one direction, refined from where it stands."""
    extend, retract = fit.structure.laws
    structure = replace(fit.structure, laws=(law, retract) if way == 0 else (extend, law))
    return fit if structure == fit.structure else fitted(fit.axis, structure, _kept(fit, structure))


def _kept(fit: Fit, structure: Structure) -> Shape:
    """What a shape has in common with another structure's."""
    return {name: value for name, value in fit.shape.items() if name in structure.shape()}


def _candidates(fit: Fit) -> list[Candidate]:
    """Everything that could be added, with its probability, the best first."""
    tried = list(_effects(fit))
    if fit.structure.curve != "monotone":
        tried.append(_best(*FREE, fit, [replace(fit.structure, curve="monotone")], ({},)))
    if not tried:
        return []
    catalogue, other = np.log(priors.CATALOGUE / len(EFFECTS)), np.log(priors.UNKNOWN)
    logs = [c.odds + (catalogue if c.id in EFFECTS else other) if c.confirmed else -np.inf for c in tried]
    total = float(log_sum(np.array([*logs, np.log(priors.NOTHING)])))
    rated = [replace(c, probability=float(np.exp(own - total))) for c, own in zip(tried, logs, strict=True)]
    return sorted(rated, key=lambda c: (-c.probability, -c.odds))


def _effects(fit: Fit) -> Iterable[Candidate]:
    structure = fit.structure
    for effect in EFFECTS.values():
        if effect.id in structure.effects or not effect.applies(fit.axis, structure.laws):
            continue
        trials = [replace(structure, effects=(*structure.effects, effect.id))]
        beside = effect.beside(fit.axis)
        if beside is not None and beside != structure.laws:
            trials.append(replace(trials[0], laws=beside))
        yield _best(effect.id, effect.title, fit, trials, effect.starts_of(fit.axis))


def _best(own: str, title: str, before: Fit, structures: Sequence[Structure], starts: Sequence[Shape]) -> Candidate:
    """The best of a candidate's shapes, begun with the delay and the edges anew, and from where they stand.

    Begun on a part of what was recorded; what comes out best is refined on all of it.
    """
    axis = _part(before.axis)
    spool, trials = {name: before.shape[name] for name in ("lag", "damping")}, []
    for structure in structures:
        trials += [fitted(axis, structure, {**spool, **start}, iterations=8) for start in starts if start]
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
