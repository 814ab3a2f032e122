r"""Changes in time: a coefficient that is not what it was (a payload picked up, a zero that stepped, a seal that went).

A column ``c`` whose coefficient steps by ``delta`` at ``t_0`` adds ``delta c(t) [t >= t_0]`` to the whitened rows. With
``e`` the residual of a fit whose column space has the orthonormal basis ``Q`` (``Q^T e = 0``), the chi-square that a
joint refit with that step would gain is::

    gain(t_0) = S^2 / V,   S = sum_{t >= t_0} c e,   V = sum_{t >= t_0} c^2 - |sum_{t >= t_0} c Q|^2

so cumulative sums give it exactly for all ``t_0`` at once. Without a change ``S / sqrt(V)`` is a Gaussian process of
unit variance, and neighbouring moments are correlated by

    rho_k = (V_k + V_{k+1} - c_k^2 (1 - |Q_k|^2)) / (2 sqrt(V_k V_{k+1}))

With ``L = -2 sum log rho_k`` (the length of the stationary process that it is in transformed time; for a plain mean,
``log((1 - a)(1 - b) / (a b))`` of Andrews' trimming) the chance of a supremum of ``z`` or more is (Vostrikova 1981)::

    p = z exp(-z^2/2) / sqrt(2 pi) * (L (1 - 1/z^2) + 4/z^2)

Knocks are clipped before the chance is computed (the gain is the plain one). What a residual keeps of colour makes
sums grow faster than they should; the gain is divided by the long-run variance of ``c e`` over its short-run one
(Newey and West), measured after the step is taken out.

Sources: D. W. K. Andrews, "Tests for parameter instability and structural change with unknown change point",
Econometrica 61, 1993; M. Csorgo and L. Horvath, "Limit theorems in change-point analysis", 1997, section 1.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.regression.design import Design
from fitting.regression.noise import Pairing
from fitting.residual.terms import Model
from fitting.residual.views import recording_starts

#: ``once``: from a moment to the end of its recording; ``lasting``: in all later recordings too; ``every``: from the
#: same moment on in every recording, as a program that picks something up does.
Kind = Literal["once", "lasting", "every"]

#: Chance that a machine on which nothing changes is reported to have changed.
CHANGE_ALARM = 1e-3
#: Share of a column's information that has to lie on either side of a change.
TRIM = 0.05
#: Below this share of its norm a column is rounding once the base is projected out.
_DEAD = 1e-4
_HAC_SECONDS = 1.5
_CLIP = 4.0  # standard deviations of the whitened noise
#: A gain within this of the best one belongs to the interval of the time (chi-square, 99 %).
_WITHIN = 6.63


@dataclass(frozen=True)
class JointRows:
    """Whitened rows of one joint, in the order of the fit.

    Attributes
    ----------
    joint : its number
    residual : (R,) whitened residual of the fit
    orthonormal : (R, rank) its rows of the fit's orthonormal basis
    time : (R,) s since the row's recording began
    recording : (R,) number of the row's recording
    unloaded : (R,) True for rows of `unloaded` recordings
    columns : whitened columns (R,) whose coefficients may have changed, by name
    """

    joint: int
    residual: FloatArray
    orthonormal: FloatArray
    time: FloatArray
    recording: IntArray
    unloaded: BoolArray
    columns: Mapping[str, FloatArray]


@dataclass(frozen=True)
class ChangePoint:
    """A moment from which on a column's coefficient is another.

    Attributes
    ----------
    joint, column : where, and whose coefficient
    kind : how far it reaches
    recording : the recording in which it happens; None for kind ``every``
    time, interval : s since that recording began, and the interval (99 %) of that time; the first row's time means the
        whole recording differs from the others
    change, std : change of the coefficient and its standard deviation
    gain : chi-square that the step gains in a joint refit
    p : chance of such a gain anywhere in time, any column and recording that was looked at, without a change
    """

    joint: int
    column: str
    kind: Kind
    recording: int | None
    time: float
    interval: tuple[float, float]
    change: float
    std: float
    gain: float
    p: float


def change_points(rows: JointRows, *, looks: int = 1, alarm: float = 1e-3) -> tuple[ChangePoint, ...]:
    """Find one joint's changes in time: the best moment per column and kind of change, most likely first.

    One change shows in several columns and kinds; the first of the list is the one to try. A column that
    was not fitted is fitted here, with one coefficient in unloaded and another in loaded recordings: neither its
    presence nor a difference between the two is a change in time (see `fitting.residual.confirmation.witness`).

    Parameters
    ----------
    rows : whitened rows and columns; later recordings have higher numbers
    looks : how many joints are looked at; the alarm rate is shared among them
    alarm : chance that all joints of a machine without changes get one
    """
    numbers = sorted(set(rows.recording.tolist()))
    spans: list[tuple[IntArray, Kind]] = [(np.flatnonzero(rows.recording == r), "once") for r in numbers]
    if len(numbers) > 1:
        spans.append((np.argsort(rows.recording, kind="stable"), "lasting"))
        spans.append((np.argsort(rows.time, kind="stable"), "every"))
    tests = max(1, looks * len(spans) * len(rows.columns))
    found = []
    for name, column in rows.columns.items():
        constant = _fitted(rows, column)
        for span, kind in spans:
            point = _best(constant, name, column, span, kind, tests, alarm, len(numbers) > 1)
            if point is not None:
                found.append(point)
    return tuple(sorted(found, key=lambda c: (c.p, -c.gain)))


def step_at(rows: JointRows, column: str, recording: int, time: float) -> tuple[float, float]:
    """Fit the change of a column's coefficient at a given moment of a recording, with its deviation.

    Zero and infinite where the recording has no rows on either side of it.
    """
    own = _fitted(rows, rows.columns[column])
    span = np.flatnonzero(rows.recording == recording)
    later = rows.time[span] >= time
    if not later.any() or later.all():
        return 0.0, np.inf
    c, e, Q = rows.columns[column][span], own.residual[span], own.orthonormal[span]
    at = int(np.argmax(later))
    score, norm = _sums(c, e, Q)
    if not norm[at] > _DEAD**2 * float(c @ c):
        return 0.0, np.inf
    change = float(score[at] / norm[at])
    return change, float(np.sqrt(_long_run(rows.time, span, c, e, Q, at, change) / norm[at]))


def _fitted(rows: JointRows, column: FloatArray) -> JointRows:
    """Add the column itself to the fitted rows, one coefficient unloaded and one loaded."""
    for part in (np.where(rows.unloaded, column, 0.0), np.where(rows.unloaded, 0.0, column)):
        inside = rows.orthonormal.T @ part
        # Its norm in the whole basis: what the projection leaves on other joints' rows counts as well.
        square = float(part @ part) - float(inside @ inside)
        if square > _DEAD**2 * float(part @ part):
            direction = (part - rows.orthonormal @ inside) / np.sqrt(square)
            residual = rows.residual - direction * float(part @ rows.residual) / np.sqrt(square)
            rows = replace(rows, residual=residual, orthonormal=np.column_stack([rows.orthonormal, direction]))
    return rows


def supremum_chance(z: float, length: float) -> float:
    """Compute the chance that a unit Gaussian process, correlation ``exp(-|lag|/2)``, reaches ``|z|`` in ``length``."""
    if z < 1.5:
        return 1.0
    density = np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
    return float(min(1.0, z * density * (length * (1 - 1 / z**2) + 4 / z**2)))


def _best(
    rows: JointRows, name: str, column: FloatArray, span: IntArray, kind: Kind, tests: int, alarm: float, several: bool
) -> ChangePoint | None:
    c, e, Q = column[span], rows.residual[span], rows.orthonormal[span]
    score, norm = _sums(c, e, Q)
    total = float(c @ c)
    if not total > 0 or len(c) < 20:
        return None
    # A step at the first row is the whole recording against the others; over all recordings it is the column itself.
    share = np.cumsum(c[::-1] ** 2)[::-1] / total
    inside = (share >= TRIM) & (share <= 1 - TRIM) & (norm > _DEAD**2 * share * total)
    inside[0] = kind == "once" and several and bool(norm[0] > _DEAD**2 * total)
    if kind == "every":  # recordings share their moments: a change is in all of them or in none
        inside[1:] &= np.diff(rows.time[span]) > 1e-6
    where = np.flatnonzero(inside)
    if not len(where):
        return None
    gain = score[where] ** 2 / norm[where]
    best = int(np.argmax(gain))
    at = int(where[best])
    length = _length(c, Q, norm, where)
    if tests * supremum_chance(float(np.sqrt(gain[best])), length) >= alarm:
        return None  # colour could only raise it
    # A few knocks must not carry it: what counts is the smaller of the plain and the clipped score.
    bound = _CLIP * max(1.0, 1.4826 * float(np.median(np.abs(e))))
    steady = min(abs(float(score[at])), abs(float(c[at:] @ np.clip(e[at:], -bound, bound))))
    excess = _long_run(rows.time, span, c, e, Q, at, score[at] / norm[at])
    p = min(1.0, tests * supremum_chance(steady / float(np.sqrt(norm[at] * excess)), length))
    if p >= alarm:
        return None
    near = where[gain >= gain[best] - _WITHIN * excess]
    if kind == "lasting":  # a time is one of its own recording
        near = near[rows.recording[span[near]] == rows.recording[span[at]]]
    times = rows.time[span]
    return ChangePoint(
        joint=rows.joint,
        column=name,
        kind=kind,
        recording=None if kind == "every" else int(rows.recording[span[at]]),
        time=float(times[at]),
        interval=(float(times[near].min()), float(times[near].max())),
        change=float(score[at] / norm[at]),
        std=float(np.sqrt(excess / norm[at])),
        gain=float(gain[best]),
        p=p,
    )


def _sums(c: FloatArray, e: FloatArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute score and projected squared norm of the column from every row on, each (R,)."""
    score = np.cumsum((c * e)[::-1])[::-1]
    inside = np.cumsum((c[:, None] * Q)[::-1], axis=0)[::-1]
    norm = np.cumsum((c**2)[::-1])[::-1] - np.einsum("ij,ij->i", inside, inside)
    return score, norm


def _length(c: FloatArray, Q: FloatArray, norm: FloatArray, where: IntArray) -> float:
    """Compute the process's length over the searched rows in units of its correlation time."""
    first, second = where[:-1], where[1:]
    if not len(first):
        return 0.0
    step = np.cumsum(np.concatenate([[0.0], c**2 * (1 - np.einsum("ij,ij->i", Q, Q))]))
    # Rows in between (trimmed away) add to the distance; cross terms of theirs are neglected.
    apart = step[second] - step[first]
    rho = (norm[first] + norm[second] - apart) / (2 * np.sqrt(norm[first] * norm[second]))
    return float(-2 * np.sum(np.log(np.clip(rho, 0.1, 1.0))))


def _long_run(
    time: FloatArray, span: IntArray, c: FloatArray, e: FloatArray, Q: FloatArray, at: int, change: float
) -> float:
    """Compute long-run over short-run variance of the score's terms, at least 1, the step taken out.

    Newey-West on the terms whitened by an autoregression of first order, and coloured again (Andrews and Monahan,
    "An improved heteroskedasticity and autocorrelation consistent covariance matrix estimator", Econometrica 60, 1992).
    """
    stepped = np.where(np.arange(len(c)) >= at, c, 0.0)
    order = np.argsort(span)  # as they were measured, whatever order the moments were searched in
    terms = (c * (e - change * (stepped - Q @ (Q.T @ stepped))))[order]
    power = float(terms @ terms)
    steps = np.diff(time[span[order]])
    steps = steps[steps > 0]
    if not power > 0 or not len(steps):
        return 1.0
    phi = float(np.clip(terms[1:] @ terms[:-1] / power, 0.0, 0.95))
    innovations = terms[1:] - phi * terms[:-1]
    total = own = float(innovations @ innovations)
    lags = min(len(innovations) // 4, round(_HAC_SECONDS / float(np.median(steps))))
    for lag in range(1, lags + 1):
        total += 2 * (1 - lag / (lags + 1)) * float(innovations[lag:] @ innovations[:-lag])
    return max(1.0, max(total, own) / (1 - phi) ** 2 / power)


def joint_rows(model: Model, joint: int) -> JointRows:
    """Return rows of one joint for :func:`change_points`, without those of a prior, which follow the measured ones.

    Coefficients that may change are those of the effort's zero (``1``), of friction, of stiffness, and of the ``load``
    as a whole: the rigid body's force as fitted, of which a change is a relative change of what the arm carries.
    """
    design, fit, bank = model.design, model.fit, model.design.bank
    begins, body, drive = recording_starts(design), design.parameters.base_slice.start, design.parameters.drive[joint]
    own = [name for name in ("f_c", "f_v", "K") if name in drive]
    numbers = [drive.index(name) for name in own]  # a joint's own drive parameters come first
    sections = model.sections(joint)
    rows = max((part.stop for _, part in sections), default=0)
    time, recording, unloaded = np.zeros(rows), np.zeros(rows, dtype=np.intp), np.zeros(rows, dtype=bool)
    columns = np.zeros((rows, len(own) + 2))
    for index, part in sections:
        segment, block = design.segments[index], design.blocks[joint][index]
        kept = design.kept(model.noise, joint, index)
        # Row k of the reduced signals is in the middle of its filter window.
        at = bank.half + bank.decimation * np.arange(len(kept))
        time[part] = segment.t[at][kept] - begins[segment.recording]
        recording[part], unloaded[part] = segment.recording, not segment.loaded
        full = np.column_stack([np.ones(len(segment)), block.own[:, numbers], block.force(fit.theta, body)])
        columns[part] = design.white(model.noise, joint, index, bank.reduce(full))
    named = dict(zip(("1", *own, "load"), columns.T.copy(), strict=True))
    return JointRows(joint, fit.residual[joint][:rows], fit.orthonormal[joint][:rows], time, recording, unloaded, named)


def changes(model: Model, pairs: Sequence[Pairing], explained: bool) -> tuple[ChangePoint, ...]:
    """Find the moments at which a joint's behaviour changes, with all findings taken into account.

    What comes back at one phase of the motion in every run of it is no change in time: not what all recordings have at
    the same moment, and not what another run of the same motion shows at that phase as well. Where the recordings are
    not ``explained`` down to their noise, the model's error has phases, too, and only a second run separates the two.
    """
    joints = len(model.design.machine.joints)
    found: list[ChangePoint] = []
    for joint in range(joints):
        rows = joint_rows(model, joint)
        for point in change_points(rows, looks=joints):
            if point.kind == "every" or point.p >= CHANGE_ALARM / joints:
                continue
            others = _other_runs(model.design, pairs, point)
            if others or explained:
                shown = [step_at(rows, point.column, recording, time) for recording, time in others]
                if not any(_is_the_same(point, *step) for step in shown):
                    found.append(point)
                break
    return tuple(found)


def _other_runs(design: Design, pairs: Sequence[Pairing], point: ChangePoint) -> list[tuple[int, float]]:
    """Return other recordings of the same motion, and their times at the same phase, s."""
    begins, result = recording_starts(design), []
    for pair in pairs:
        sides = ((design.segments[pair.train], pair.train_start), (design.segments[pair.repeat], pair.repeat_start))
        since = {own.recording: float(own.t[start]) - begins[own.recording] for own, start in sides}
        if point.recording in since:
            (other,) = since.keys() - {point.recording}
            result.append((other, point.time + (since[other] - since[point.recording])))
    return result


def _is_the_same(point: ChangePoint, change: float, std: float) -> bool:
    """Return whether another run shows the same change: at least half of it, or what chance leaves open."""
    return change / point.change > 0.5 or abs(change - point.change) < 2.0 * std
