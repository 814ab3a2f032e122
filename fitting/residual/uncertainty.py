"""Uncertainty of the final model: what a joint fit with everything held fixed does not know.

Three things make the standard deviations of a least-squares fit too small once a model was *found*:

shapes
    An effect's formula has parameters that are not linear (a Stribeck speed, an onset, a resonance), which were
    searched; each gets a column, the formula's derivative by its relative change, so that linear parameters share its
    doubt.
laws
    What part of a law of unknown physics lies in the base's own columns cannot be told, and is expected to be twice as
    large as what was found beside them. And what parameters move by when the law is added is doubt as well: the law is
    a spline, not nature's formula.
noise
    The spectrum that rows were whitened by was estimated (:mod:`fitting.freedom`).

Source: G. Seber and C. Wild, *Nonlinear Regression*, 1989, section 2.1 (linear approximation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fitting.effects.base import Effect
from fitting.freedom import coverage_factors, degrees_of_freedom
from fitting.prior import Prior
from fitting.regression import WhiteRows
from fitting.residual.laws import Law
from fitting.residual.refinement import CHOICES
from fitting.residual.terms import Model, Term, extra_columns

FloatArray = npt.NDArray[np.float64]

#: Relative step of a shape's numerical derivative, and what is known of a shape beforehand, relative.
_STEP, _SHAPE_STD = 0.004, 0.5
#: The share of an unknown law that lies in the base's columns, in units of what lies beside them.
_HIDDEN = 2.0


def with_doubts(model: Model, prior: Prior) -> Model:
    """The model with a covariance that knows what was searched, what is unknown, and how well the noise is known.

    Values do not change. Recordings that are too long for memory keep their covariance: shapes and spectra of hours
    are known well.
    """
    if model.design.stored:
        return model
    rows = model.rows(prior)
    covariance = _with_shapes(model, rows)
    covariance = covariance + np.diag(_law_variances(model, rows))
    freedom = degrees_of_freedom(rows, model.fit.covariance, model.noise, model.design.bank.reduced_rate_hz)
    factors = coverage_factors(freedom)
    covariance = covariance * factors[:, None] * factors[None, :]
    return replace(model, fit=replace(model.fit, covariance=covariance))


def _with_shapes(model: Model, rows: Sequence[WhiteRows]) -> FloatArray:
    """Covariance (p, p) with the shapes of effects free to move."""
    slopes = [slope for number in range(len(model.terms)) for slope in _slopes(model, number)]
    told = model.fit.told
    if not slopes:
        return model.fit.covariance
    D = np.column_stack(slopes)
    A = np.vstack([own.A[:, told] for own in rows])
    # Of the covariance with D beside A: C + C A'D (D'D + P - D'A C A'D)^-1 D'A C.
    C = model.fit.covariance[np.ix_(told, told)]
    shift = C @ (A.T @ D)
    left = D.T @ D + np.eye(D.shape[1]) / _SHAPE_STD**2 - (A.T @ D).T @ shift
    covariance = model.fit.covariance.copy()
    covariance[np.ix_(told, told)] += shift @ np.linalg.solve(left, shift.T)
    return covariance


def _slopes(model: Model, number: int) -> list[FloatArray]:
    """Derivatives of a term's contribution by the logarithm of each of its shapes, in the rows of all joints."""
    term = model.terms[number]
    if not isinstance(term.content, Effect) or term.rebuilt:
        return []
    values = model.fit.theta[model.term_slice(number)]
    result = []
    for key, value in term.shape.items():
        if key in CHOICES or not value:
            continue
        up, down = (
            _contribution(model, replace(term, shape={**term.shape, key: value * factor}), values)
            for factor in (1 + _STEP, 1 - _STEP)
        )
        slope = (up - down) / (2 * _STEP)
        if np.isfinite(slope).all() and slope.any():
            result.append(slope)
    return result


def _contribution(model: Model, term: Term, values: FloatArray) -> FloatArray:
    """A term's whitened contribution in the rows of all joints, in the order of the fit's (a prior's row is 0)."""
    extra = extra_columns(model.design, model.views, [term])
    parts = []
    for joint in range(len(model.design.machine.joints)):
        rows = np.zeros(len(model.fit.residual[joint]))
        start = 0
        for index in model.fitted:
            kept = model.noise.kept(joint, model.design.blocks[joint][index].keep)
            count, own = int(np.count_nonzero(kept)), extra.columns[joint][index]
            if own is not None:
                rows[start : start + count] = model.noise.whiten(joint, model.design.bank.reduce(own @ values))[kept]
            start += count
        parts.append(rows)
    return np.concatenate(parts)


def _law_variances(model: Model, rows: Sequence[WhiteRows]) -> FloatArray:
    """Variance (p,) that unknown laws add to the drive parameters of their joints."""
    variances = np.zeros(len(model.fit.theta))
    count = len(model.design.parameters)
    if not any(isinstance(term.content, Law) for term in model.terms):
        return variances
    named = [
        isinstance(term.content, Effect) for term in model.terms for _ in term.names(model.design.parameters.joints)
    ]
    without = np.flatnonzero(model.fit.told & np.concatenate([np.ones(count, dtype=bool), np.array(named)]))
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
            if scale[place] > 0 and model.fit.told[place]:
                share = float(np.sum((directions.T @ (own[:, place] / scale[place])) ** 2))
                variances[place] += share * (_HIDDEN * float(np.linalg.norm(beside)) / scale[place]) ** 2
    return variances
