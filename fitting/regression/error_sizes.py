"""Sizes of errors: standard deviation, root mean square, mean and relative error, of each joint and of all together.

The standard deviation does not see a constant offset; the root mean square and the mean do. The relative error is
``|measured - predicted| / |measured|`` (Euclidean norms over the same filtered rows), as published identifications of
measured arms give it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.regression.design import Design, Extra, effort_errors, moving_efforts

#: Which recordings each column of a report's errors is of.
ROLES = {"train": ("train", "operation"), "validate": ("validate",)}
#: What a report calls the ways to one relative error of all joints.
STACKED, JOINTS = "stacked", "joints"

_MOST_LAGS = 200

Sizes = dict[str, list[float | None]]


def measured_efforts(design: Design, indices: Sequence[int]) -> tuple[FloatArray, ...]:
    """Compute per joint the filtered measured joint effort (N m or N) on the rows of
    :func:`fitting.regression.design.effort_errors`.
    """

    def measured(joint: int, index: int) -> FloatArray:
        segment = design.segments[index]
        return design.bank.reduce(segment.r[:, joint] * segment.effort[:, joint])

    return moving_efforts(design, indices, measured)


def sizes(role: str, errors: Sequence[FloatArray], efforts: Sequence[FloatArray]) -> Sizes:
    """Compute all sizes of one role's errors, each a list over joints; None where no rows are.

    Parameters
    ----------
    role : ``train`` or ``validate``: the bare key, and the beginning of the others
    errors, efforts : per joint (M_j,) measured minus predicted effort, and the measured effort, on the same rows
    """
    return {
        role: [float(np.std(e)) if len(e) else None for e in errors],
        f"{role}_rms": [float(np.sqrt(np.mean(e**2))) if len(e) else None for e in errors],
        f"{role}_mean": [float(np.mean(e)) if len(e) else None for e in errors],
        f"{role}_relative": [_relative(e, tau) for e, tau in zip(errors, efforts, strict=True)],
    }


def errors_of(
    design: Design, theta: FloatArray, extra: Extra | None = None
) -> tuple[Sizes, dict[str, tuple[FloatArray, ...]], dict[str, Any]]:
    """Compute sizes of a model's errors in both roles, the errors by role, and all joints' relative error.

    Parameters
    ----------
    theta : (p,) parameters of the design, then those of ``extra``
    """
    units = [joint.effort_unit for joint in design.machine.joints]
    found: Sizes = {}
    series: dict[str, tuple[FloatArray, ...]] = {}
    relative: dict[str, Any] = {}
    for role, names in ROLES.items():
        indices = design.indices(*names)
        errors, efforts = effort_errors(design, theta, indices, extra), measured_efforts(design, indices)
        found |= sizes(role, errors, efforts)
        series[role] = errors
        relative[role] = overall_relative(errors, efforts, units)
    return found, series, relative | {"of": STACKED if len(set(units)) == 1 else JOINTS}


def overall_relative(errors: Sequence[FloatArray], efforts: Sequence[FloatArray], units: Sequence[str]) -> float | None:
    """Compute one relative error of all joints; None without rows or effort.

    Where all efforts have one unit, the norm of all joints' errors over that of all joints' efforts. N and N m do not
    add: where both occur, the root mean square of the joints' own relative errors.
    """
    if len(set(units)) == 1:
        return _relative(np.concatenate(errors), np.concatenate(efforts))
    single = [_relative(e, tau) for e, tau in zip(errors, efforts, strict=True)]
    known = [value for value in single if value is not None]
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def overall_errors(
    found: Mapping[str, tuple[Sizes, Any, Mapping[str, Any]]], floor: npt.ArrayLike, shown: str
) -> dict[str, Any]:
    """Report all joints together beside the standard deviation, before and after.

    Parameters
    ----------
    found : ``before`` and ``after``: what :func:`errors_of` gives
    floor : (n,) noise floor of each joint
    shown : the role that ``before`` and ``after`` are of; training has keys of its own

    Returns
    -------
    dict
        ``rms`` and ``mean`` (root mean square over the joints of each in its noise floors) and ``relative``
        (:func:`overall_relative`; ``of`` gives the way), each with ``before``, ``after``, ``train_before``,
        ``train_after``.
    """
    result: dict[str, Any] = {"rms": {}, "mean": {}, "relative": {}}
    for prefix, role in (("", shown), ("train_", "train")):
        for state, (of_joints, _, relative) in found.items():
            result["relative"][f"{prefix}{state}"] = relative[role]
            for size in ("rms", "mean"):
                result[size][f"{prefix}{state}"] = in_floors(of_joints[f"{role}_{size}"], floor)
    return result | {"relative": result["relative"] | {"of": found["after"][2]["of"]}}


def independent_rows(errors: Sequence[FloatArray]) -> float:
    """Count independent rows with as much information on the errors' power as these, in all.

    ``N / (1 + 2 sum_k r_k^2)`` of each joint, ``r_k`` the autocorrelation (M. S. Bartlett, *Stochastic Processes*,
    1955, ch. 9: variance of a variance).
    """
    total = 0.0
    for e in errors:
        power = float(e @ e)
        if len(e) > 2 and power > 0:
            lags = range(1, min(len(e) // 4, _MOST_LAGS) + 1)
            correlation = np.array([e[k:] @ e[:-k] for k in lags]) / power
            total += len(e) / (1.0 + 2.0 * float(np.sum(correlation**2)))
    return total


def in_floors(values: Sequence[float | None], floor: npt.ArrayLike | Sequence[float | None]) -> float | None:
    """Compute error over noise floor, RMS over the joints; None where no joint has both."""
    pairs = zip(values, np.asarray(floor, dtype=float), strict=True)
    scaled = [value / own for value, own in pairs if value is not None and own > 0]
    return float(np.sqrt(np.mean(np.square(scaled)))) if scaled else None


def _relative(error: FloatArray, effort: FloatArray) -> float | None:
    norm = float(np.linalg.norm(effort))
    return float(np.linalg.norm(error)) / norm if norm > 0 else None
