"""Which parameters a recording can determine, and how well: for `operation` recordings, and for planned motions.

A day's work is no excitation: joints that hardly moved, poses that were never left. A fit gives numbers for all
parameters all the same. What may be reported of each is decided by its standard deviation over its size:

``told``         known to 30 %, by the recordings alone
``assumed``      more than half of what is known of it was put in beforehand (a prior), not measured
``poorly told``  known to its own size
``not told``     less than that, or no row depends on it alone

A parameter's size is its own value, or that of its kind where that is larger, so that one which happens to be near
zero is not blamed for it: the first moments (or the moments of inertia) of a link together, and all of a cylinder's
friction at the top speed that was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray, unit_gram
from fitting.regression.design import Design, NoiseModel, whitened
from fitting.regression.prior import Prior, rows_of_prior

Verdict = Literal["told", "poorly told", "not told", "assumed"]

#: Relative standard deviation above which a parameter is flagged, and above which it is not determined at all.
FLAGGED, HOPELESS = 0.3, 1.0
_RANK = 1e-14  # of the largest eigenvalue of unit columns' products: what is less is rounding
_CONCERNED = 1e-6  # share of a null direction's norm from which on a parameter takes part in it


@dataclass(frozen=True)
class ParameterVerdict:
    """Verdict on one parameter.

    Attributes
    ----------
    name : as in the regression
    verdict : see the module's text
    std : standard deviation in the parameter's unit; infinite where rows do not determine it
    relative : ``std`` over the parameter's size
    """

    name: str
    verdict: Verdict
    std: float
    relative: float

    def to_json(self) -> dict[str, Any]:
        """Return content of reports and forecasts; None for what is infinite."""
        return {key: None if value == np.inf else value for key, value in vars(self).items()}


def parameter_verdicts(
    design: Design,
    noise: NoiseModel,
    indices: Sequence[int],
    theta: FloatArray,
    prior: Prior | None = None,
) -> tuple[ParameterVerdict, ...]:
    """Compute what a motion shows of each drive and base parameter.

    Parameters
    ----------
    design : of recordings or of planned motions
    noise : of the efforts; a motion's information is nothing without it
    indices : the segments to go by
    theta : (p,) values of the parameters, as fitted or guessed: what their deviations are measured by
    prior : what the fit also knows

    Notes
    -----
    ``cov = (A'A)^-1`` over the directions that rows show; a parameter with a part in a direction that they do not
    has no finite deviation.
    """
    size = len(design.parameters)
    measured = np.zeros((size, size))
    for index in indices:
        measured += sum(own.A.T @ own.A for own in whitened(design, noise, (index,)))
    both = measured
    if prior is not None:
        known, _ = rows_of_prior(design.parameters, prior, size)
        both = measured + known.T @ known
    alone, together = np.sqrt(_variances(measured)), np.sqrt(_variances(both))
    sizes = parameter_sizes(design, indices, theta)
    result = []
    for k, name in enumerate(design.parameters.names):
        relative = float(together[k] / sizes[k])
        if alone[k] <= FLAGGED * sizes[k]:
            verdict: Verdict = "told"
        elif relative <= HOPELESS and together[k] ** 2 < 0.5 * alone[k] ** 2:
            verdict = "assumed"
        else:
            verdict = "told" if relative <= FLAGGED else "poorly told" if relative <= HOPELESS else "not told"
        result.append(ParameterVerdict(name, verdict, float(together[k]), relative))
    return tuple(result)


def parameter_sizes(design: Design, indices: Sequence[int], theta: FloatArray) -> FloatArray:
    """Return the size (p,) of each parameter, in its unit; see the module."""
    parameters = design.parameters
    sizes = np.abs(np.asarray(theta, dtype=float)[: len(parameters)])
    for joint, names in enumerate(parameters.drive):
        part = parameters.drive_slice(joint)
        fastest = max(float(np.abs(design.segments[i].v[:, joint]).max()) for i in indices)
        at_top = {"f_c": 1.0, "f_v": fastest, "f_s": float(np.cbrt(fastest))}
        own = [(part.start + k, at_top[name]) for k, name in enumerate(names) if name in at_top]
        friction = float(np.sqrt(sum((sizes[k] * force) ** 2 for k, force in own)))
        for k, force in own:
            sizes[k] = max(sizes[k], friction / force) if force > 0 else sizes[k]
    base, values = parameters.base, sizes[parameters.base_slice].copy()
    for k in range(len(base)):
        if base.independent[k] >= base.inertial_columns:
            continue
        link = base.independent // 10
        same = (link == link[k]) & (base.independent < base.inertial_columns)
        alike = [i for i in np.flatnonzero(same) if base.units[i] == base.units[k]]
        sizes[parameters.drive_count + k] = float(np.sqrt(np.mean(values[alike] ** 2)))
    return np.asarray(np.maximum(sizes, 1e-12))


def _variances(G: FloatArray) -> FloatArray:
    """Compute the inverse's diagonal; infinite for parameters in a direction without information."""
    unit, size = unit_gram(G)
    values, vectors = np.linalg.eigh(unit)
    determined = values > _RANK * values.max(initial=0.0)
    inside = np.sum(vectors[:, determined] ** 2 / values[determined], axis=1) / size**2
    return np.where(np.sum(vectors[:, ~determined] ** 2, axis=1) > _CONCERNED**2, np.inf, inside)


def statement(found: Sequence[ParameterVerdict]) -> str:
    """Word in one sentence how many parameters the motion determines, and which not."""
    determined = [t.name for t in found if t.verdict == "told"]
    text = Sentence("fitting.motion_tells_parameters", told=len(determined), of=len(found))
    for verdict in ("assumed", "poorly told", "not told"):
        names = [t.name for t in found if t.verdict == verdict]
        if names:
            text += Sentence(f"fitting.{verdict.replace(' ', '_')}", names=names)
    return text
