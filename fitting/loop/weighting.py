"""Weights of the fit that is handed out: those of the measured noise, or equal ones.

Generalised least squares weighs rows by the spectrum of the measurement noise. That is best where the model explains
the efforts down to that noise. Where it does not, what is left is no noise, and those weights mislead: a repeated
motion shows fast noise far below the slow error of the model, so the whitened rows all but ignore the slow error,
although nearly all of the effort is slow.

Equal weights minimise the error of the effort itself, whatever is left. A right model loses next to nothing on the
training motion by the other weights, so what it loses shows which case this is::

    ratio = error of the whitened fit / error of least squares,   training motions,

as the larger of two: the error of all efforts together, and each joint's in units of its own. Above
:data:`MOST_LOST` equal weights are handed out, and where rows are no more than parameters: least squares leaves nothing
of them but rounding, which shows nothing of noise.

Where the number comes from: sound simulated arms have at most 1.006, arms that lack an effect 1.0 to 1.08, measured
machines 1.04 to 1.8 (``docs/decisions/0034-weights-on-measured-machines.md``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from fitting.arrays import FloatArray
from fitting.estimators.effort_fit import EffortRows
from fitting.regression.prior import Prior
from fitting.regression.solving import Fit, WhiteRows
from fitting.residual.confirmation.uncertainty import law_variances, shape_columns, with_uncertainties
from fitting.residual.terms import Model, beside, fit_model

Weights = Literal["whitened", "equal"]

#: Training error of the whitened fit over that of least squares up to which its weights are kept.
MOST_LOST = 1.02


@dataclass(frozen=True)
class Weighed:
    """The fit that is handed out, and the others that were tried.

    Attributes
    ----------
    model : with the chosen fit and its covariance
    weights : which it is
    ratio : training error of the whitened fit over that of least squares
    tried : parameters (p,) by name: ``whitened``, ``equal``, ``least_squares`` (equal, without a plausible arm), and of
        a base model ``possible`` (the nearest that physics allows)
    errors : (n,) training error of each of them, root mean square of every joint's effort
    """

    model: Model
    weights: Weights
    ratio: float
    tried: Mapping[str, FloatArray] = field(repr=False)
    errors: Mapping[str, FloatArray] = field(repr=False)


def weighed(
    model: Model, prior: Prior, weights: Weights | None = None, settled_on: EffortRows | None = None
) -> Weighed:
    """Decide the weights of a model's final fit.

    Parameters
    ----------
    model : fitted on whitened rows
    prior : what is known beforehand
    weights : which they are to be; None decides. A base model is compared with what the loop made of it in the same
        weights: it may look wrong for want of an effect that the loop then adds.
    settled_on : the model's effort rows, where the prior is settled on them already
    """
    rows = settled_on or EffortRows(model.design, model.fitted, model.extra)
    settled = prior if settled_on is not None else rows.settled(prior)
    if model.prior is None or settled.refused != model.prior.refused:
        model = fit_model(model.design, model.noise, model.fitted, model.terms, settled, model)
    equal = _equal(model, rows, settled)
    tried = {"whitened": model.fit.theta, "equal": equal.theta, "least_squares": rows.least_squares(prior)}
    if not model.terms and prior.arm is not None:
        tried["possible"] = rows.possible(prior)
    errors = {name: rows.errors(theta) for name, theta in tried.items()}
    ratio = _error_ratio(rows, errors["whitened"], np.fmin(errors["equal"], errors["least_squares"]))
    if weights is None:
        few = rows.rows.sum() <= len(model.fit.theta)
        weights = "equal" if few or ratio > MOST_LOST else "whitened"
    if weights == "whitened":
        return Weighed(with_uncertainties(model), "whitened", ratio, tried, errors)
    return Weighed(replace(model, fit=equal, prior=settled), "equal", ratio, tried, errors)


def _error_ratio(rows: EffortRows, whitened: FloatArray, equal: FloatArray) -> float:
    """Return the larger of this module's two ratios, of joints' RMS errors (n,); 1 where nothing was fitted."""
    counts = rows.rows.astype(float)
    there = (counts > 0) & (equal > 0)
    if not there.any():
        return 1.0
    ratios = []
    for unit in (np.ones(len(counts)), np.where(there, equal, 1.0)):
        first, second = (float(np.sum(counts[there] * (e[there] / unit[there]) ** 2)) for e in (whitened, equal))
        ratios.append(np.sqrt(first / second))
    return float(max(ratios))


def _equal(model: Model, rows: EffortRows, prior: Prior) -> Fit:
    """Fit with equal weights, with deviations that include searched shapes and unknown laws."""
    fit = rows.fit(prior)
    slopes = None if model.design.stored else shape_columns(model)
    count = len(fit.theta)
    if slopes is not None:
        wide = EffortRows(model.design, model.fitted, beside([model.extra, slopes])).fit(prior)
        fit = replace(fit, covariance=wide.covariance[:count, :count])
    if not model.design.stored and any(term.id == "law" for term in model.terms):
        parts = (zip(*rows.parts(joint), strict=True) for joint in range(len(model.design.machine.joints)))
        white = [WhiteRows(np.vstack(A), np.concatenate(b), ()) for A, b in parts]
        hidden = law_variances(replace(model, fit=fit), white)
        fit = replace(fit, covariance=fit.covariance + np.diag(hidden), hidden=hidden)
    return fit
