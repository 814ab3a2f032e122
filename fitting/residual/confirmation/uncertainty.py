"""Uncertainty of the final model: what a joint fit with everything held fixed does not know.

Three things make the standard deviations of a least-squares fit too small once a model was *found*:

shapes
    An effect's formula has parameters that are not linear (a Stribeck speed, an onset, a resonance), which were
    searched; each gets a column, the formula's derivative by its relative change, so that linear parameters share its
    uncertainty.
laws
    What part of a law of unknown physics lies in the base's own columns is unknown, and is expected to be twice as
    large as what was found beside them. And by what parameters move when the law is added is uncertain: the law is
    a spline, not nature's formula.
noise
    The spectrum that rows were whitened by was estimated (:mod:`fitting.regression.freedom`). And where a joint's
    whitened residual is refused as white and normal noise, or an effect was found there whose formula need not be
    nature's, its rows count with the variance of their scores (a sandwich, Newey and West's).

Source: G. Seber and C. Wild, *Nonlinear Regression*, 1989, section 2.1 (linear approximation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from daq.recordings.recording_checks import runs
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.estimators.covariance import series_scores
from fitting.regression.design import Extra
from fitting.regression.freedom import coverage_factors, degrees_of_freedom
from fitting.regression.solving import WhiteRows
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, beside, extra_columns
from fitting.signals.filters import FilterBank

#: Relative step of a shape's numerical derivative, and what is known of a shape beforehand, relative.
_STEP, _SHAPE_STD = 0.004, 0.5
#: The share of an unknown law that lies in the base's columns, in units of what lies beside them.
_HIDDEN = 2.0
#: Chance that white and normal noise is refused as such, and rows of a stretch that show something of its spectrum.
REFUSED, _SHORTEST = 1e-3, 32
#: Share of the bandwidth below which whitened noise is flat: the filter falls around it.
_INSIDE = 0.9


def with_uncertainties(model: Model) -> Model:
    """Return the model with a covariance that includes searched shapes, unknown laws and the noise's own uncertainty.

    Values do not change. Recordings that are too long for memory keep their covariance: shapes and spectra of hours
    are known well.
    """
    if model.design.stored:
        return model
    rows = model.rows()[: len(model.fit.residual)]  # by joint: the covariance knows already what laws expect
    covariance = _with_shapes(model, rows)
    hidden = law_variances(model, rows)
    freedom = degrees_of_freedom(rows, model.fit.covariance, model.noise, model.design)
    factors = coverage_factors(freedom) * sandwich_factors(model, rows)
    covariance = (covariance + np.diag(hidden)) * factors[:, None] * factors[None, :]
    return replace(model, fit=replace(model.fit, covariance=covariance, hidden=hidden * factors**2))


def sandwich_factors(model: Model, rows: Sequence[WhiteRows]) -> FloatArray:
    """Compute factors (p,), at least 1, that turn deviations into sandwich ones on joints that ask for it.

    The variance of a parameter is ``c' S c`` with ``c`` its row of the covariance and ``S`` the sum over the joints of
    ``A_j'A_j`` (unit noise), or of the long-run covariance of ``A_j' e_j`` where the noise is rejected.
    """
    named = {term.joint for term in model.terms if not term.everywhere}
    covariance = model.fit.covariance
    more = np.zeros_like(covariance)
    rng = np.random.default_rng(0)  # the sum over lags does not draw
    for joint, (own, residual) in enumerate(zip(rows, model.fit.residual, strict=True)):
        if not own.sections or not (joint in named or is_refused(own, residual, model.design.bank)):
            continue
        size = np.maximum(np.linalg.norm(own.A, axis=0), 1e-300)
        for _, part in model.sections(joint):
            A, e = own.A[part] / size, residual[part]
            if len(e):
                more += np.outer(size, size) * (series_scores(A, e, "hac", rng) - A.T @ A)
    variance = np.diag(covariance)
    raised = variance + np.einsum("ij,jk,ik->i", covariance, more, covariance)
    return np.sqrt(np.where(variance > 0, np.maximum(raised, variance) / np.where(variance > 0, variance, 1.0), 1.0))


def is_refused(rows: WhiteRows, residual: FloatArray, bank: FilterBank) -> bool:
    """Return whether a joint's whitened residual is rejected as white in band and normal.

    White: the cumulated periodogram of frequencies below the bandwidth is a straight line (Kolmogorov and Smirnov's
    distance; M. S. Bartlett, *Stochastic Processes*, 1955, ch. 9); the filter leaves nothing beyond. Normal: skewness
    and kurtosis (C. Jarque and A. Bera, Economics Letters 6, 1980), of as many values as the band leaves independent.
    """
    frequencies, powers, values, start = [], [], [], 0
    for _, kept in rows.sections:
        part = residual[start : start + int(np.count_nonzero(kept))]
        start += len(part)
        values.append(part)
        ends = np.cumsum([run.stop - run.start for run in runs(kept)]) if len(part) else np.zeros(0, dtype=int)
        for e in np.split(part, ends[:-1]):
            if len(e) >= _SHORTEST:
                own = np.fft.rfftfreq(len(e), 1.0 / bank.reduced_rate_hz)
                inside = (own > 0) & (own <= _INSIDE * bank.bandwidth_hz)
                frequencies.append(own[inside])
                powers.append((np.abs(np.fft.rfft(e)) ** 2)[inside] / len(e))
    if not powers or sum(map(len, powers)) < _SHORTEST:
        return False
    power = np.concatenate(powers)[np.argsort(np.concatenate(frequencies), kind="stable")]
    lines = len(power)
    distance = float(np.max(np.abs(np.cumsum(power) / power.sum() - np.arange(1, lines + 1) / lines)))
    everything = np.concatenate(values)
    everything = everything / np.sqrt(np.mean(everything**2))
    skew, tail = float(np.mean(everything**3)), float(np.mean(everything**4)) - 3.0
    share = min(1.0, 2.0 * bank.bandwidth_hz / bank.reduced_rate_hz)
    bera = share * len(everything) / 6.0 * (skew**2 + tail**2 / 4.0)
    return bool(
        scipy.stats.kstwobign.sf(distance * np.sqrt(lines)) < REFUSED / 2 or scipy.stats.chi2.sf(bera, 2) < REFUSED / 2
    )


def _with_shapes(model: Model, rows: Sequence[WhiteRows]) -> FloatArray:
    """Compute the covariance (p, p) with the shapes of effects free to move."""
    slopes = shape_columns(model)
    determined = model.fit.determined
    if slopes is None:
        return model.fit.covariance
    D = _white(model, slopes)
    A = np.vstack([own.A[:, determined] for own in rows])
    # Of the covariance with D beside A: C + C A'D (D'D + P - D'A C A'D)^-1 D'A C.
    C = model.fit.covariance[np.ix_(determined, determined)]
    shift = C @ (A.T @ D)
    left = D.T @ D + np.eye(D.shape[1]) / _SHAPE_STD**2 - (A.T @ D).T @ shift
    covariance = model.fit.covariance.copy()
    covariance[np.ix_(determined, determined)] += shift @ np.linalg.solve(left, shift.T)
    return covariance


def shape_columns(model: Model) -> Extra | None:
    """Compute full-rate columns of terms' derivatives by the logarithm of each shape; None without any shape."""
    slopes = list[Extra]()
    for number, term in enumerate(model.terms):
        values = model.fit.theta[model.term_slice(number)]
        for key, value in term.shape.items() if isinstance(term.content, Effect) and not term.rebuilt else ():
            if key in term.discrete or not value:
                continue
            slope = _slope(model, term, key, values)
            found = [c for joint in slope for c in joint if c is not None]
            if all(np.isfinite(c).all() for c in found) and any(c.any() for c in found):
                slopes.append(Extra((f"{term.id}.{key}",), slope))
    return beside(slopes) if slopes else None


def _slope(model: Model, term: Term, key: str, values: FloatArray) -> list[list[FloatArray | None]]:
    """Differentiate a term's contribution by the log of one shape, per joint and segment (N, 1)."""

    def at(factor: float) -> Sequence[Sequence[FloatArray | None]]:
        moved = replace(term, shape={**term.shape, key: term.shape[key] * factor})
        return extra_columns(model.design, model.views, [moved]).columns

    def slope(up: FloatArray | None, down: FloatArray | None) -> FloatArray | None:
        return None if up is None or down is None else ((up - down) @ values / (2 * _STEP))[:, None]

    both = zip(at(1 + _STEP), at(1 - _STEP), strict=True)
    return [[slope(*pair) for pair in zip(*joint, strict=True)] for joint in both]


def _white(model: Model, extra: Extra) -> FloatArray:
    """Return whitened columns in the rows of all joints, in the fit's order (a prior's row is 0)."""
    parts, bank = [], model.design.bank
    for joint, residual in enumerate(model.fit.residual):
        rows = np.zeros((len(residual), len(extra.names)))
        for index, part in model.sections(joint):
            own = extra.columns[joint][index]
            if own is not None:
                rows[part] = model.design.white(model.noise, joint, index, bank.reduce(own))
        parts.append(rows)
    return np.vstack(parts)


def law_variances(model: Model, rows: Sequence[WhiteRows]) -> FloatArray:
    """Compute the variance (p,) that unknown laws add to their joints' drive parameters."""
    variances = np.zeros(len(model.fit.theta))
    count = len(model.design.parameters)
    if not any(isinstance(term.content, Law) for term in model.terms):
        return variances
    without = model.fit.determined.copy()
    for number, term in enumerate(model.terms):
        without[model.term_slice(number)] &= isinstance(term.content, Effect)
    A = np.vstack([own.A[:, without] for own in rows])
    unit = np.linalg.norm(A, axis=0)
    plain = np.linalg.lstsq(A / unit, np.concatenate([own.b for own in rows]), rcond=1e-12)[0] / unit
    variances[without] += (model.fit.theta[without] - plain) ** 2
    for number, term in enumerate(model.terms):
        if not isinstance(term.content, Law) or term.joint is None:
            continue
        part, own = model.term_slice(number), rows[term.joint].A
        law = own[:, part]
        found = law @ model.fit.theta[part]
        scale = np.linalg.norm(own[:, :count], axis=0)
        there = np.flatnonzero(scale > 0)
        base = own[:, there] / scale[there]
        beside = found - base @ np.linalg.lstsq(base, found, rcond=1e-8)[0]
        span = np.linalg.svd(law / max(float(np.linalg.norm(law)), 1e-300), full_matrices=False)
        directions = span[0][:, span[1] > 1e-6 * span[1][0]]
        drive = model.design.parameters.drive_slice(term.joint)
        for place in range(drive.start, drive.stop):
            if scale[place] > 0 and model.fit.determined[place]:
                share = float(np.sum((directions.T @ (own[:, place] / scale[place])) ** 2))
                variances[place] += share * (_HIDDEN * float(np.linalg.norm(beside)) / scale[place]) ** 2
    return variances
