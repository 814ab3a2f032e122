"""Data of the report's figures, computed from the models before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import scipy

from fitting.arrays import FloatArray
from fitting.effects.base import Parity, signal_of
from fitting.effects.variables import NEIGHBOUR, OWN, values_of
from fitting.regression.design import effort_residual, full_residual
from fitting.regression.drive import UNITS, drive_columns, effort_unit
from fitting.report.joint_words import joint_words
from fitting.report.model import Course, FrictionCurve, JointDiagnostics, Scatter
from fitting.residual.laws import Law
from fitting.residual.simple_formulas import nearest_formula
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model, Term
from fitting.signals.splines import evaluate

_GRID = 61
_ROWS = 7  # of a surface, over its second signal
_FRICTION = ("f_c", "f_v", "f_s")
#: Longest lag, s, and most lags.
_LONGEST_S, _LAGS = 4.0, 60
_BOUND = 2.576  # 99 % of a normal distribution
_WINDOW = 256


def spline_curve(law: Law, values: FloatArray, covariance: FloatArray) -> dict[str, Any]:
    """Evaluate a law with coefficients (k,) and covariance (k, k) on a grid of its variable, in drive effort.

    A law of two signals is given along its first one, at that end of the second where it is larger; ``second`` holds
    the rest. One of a single signal has the simple formula that comes nearest to it.
    """
    grid = np.linspace(law.knots[0], law.knots[-1], _GRID)
    if isinstance(law, Surface):
        rows = np.linspace(*law.second_range, _ROWS)
        whole = [law.basis(grid, np.full(_GRID, row)) for row in rows]
        shown = max((0, _ROWS - 1), key=lambda number: float(np.sum((whole[number] @ values) ** 2)))
        curve = _with_band(whole[shown], values, covariance)
        second = {
            "signal": law.second,
            "other": law.second_other,
            "unit": law.along.unit,
            "at": float(rows[shown]),
            "grid": rows.tolist(),
            "value": [(basis @ values).tolist() for basis in whole],
        }
        return {"grid": grid.tolist(), **curve, "second": second}
    curve = _with_band(evaluate(np.asarray(law.knots), grid), values, covariance)
    formula = nearest_formula(grid, curve["value"], curve["std"])
    return {"grid": grid.tolist(), **curve, "formula": None if formula is None else asdict(formula)}


def _with_band(basis: FloatArray, values: FloatArray, covariance: FloatArray) -> dict[str, list[float]]:
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", basis, covariance, basis), 0.0))
    return {"value": (basis @ values).tolist(), "std": std.tolist()}


def scatters(before: Model, after: Model, shown: Sequence[int]) -> tuple[Scatter, ...]:
    """Return residual drive effort against the variable of each final term.

    Two laws of one signal at one joint, one the same both ways and one that turns its sign with the direction of
    motion, are drawn once: what was found is their sum forth and their difference back.
    """
    pairs = _pairs(after)
    second = set(pairs.values())
    return tuple(
        _scatter(before, after, number, shown, pairs.get(number))
        for number in range(len(after.terms))
        if number not in second
    )


def _pairs(model: Model) -> dict[int, int]:
    """Pair a law's number with that of the other sign, of the same signal and joint."""
    found: dict[tuple[Any, ...], int] = {}
    pairs = {}
    for number, term in enumerate(model.terms):
        law = term.content
        if not isinstance(law, Law) or isinstance(law, Surface):
            continue
        first = found.setdefault((term.joint, law.signal, law.other), number)
        if first != number and first not in pairs and _law(model, first).parity != law.parity:
            pairs[first] = number
    return pairs


def _law(model: Model, number: int) -> Law:
    law = model.terms[number].content
    assert isinstance(law, Law)
    return law


def _both_ways(model: Model, numbers: tuple[int, int]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Add two laws: grid, sum at positive and at negative speed, and the larger of their deviations."""
    laws = [_law(model, number) for number in numbers]
    grid = np.linspace(max(law.knots[0] for law in laws), min(law.knots[-1] for law in laws), _GRID)
    part = np.concatenate([np.arange(s.start, s.stop) for s in map(model.term_slice, numbers)])
    theta, covariance = model.fit.theta[part], model.fit.covariance[np.ix_(part, part)]
    bases = [evaluate(np.asarray(law.knots), grid) for law in laws]
    ways = [
        _with_band(np.hstack([law.factor(way) * b for b, law in zip(bases, laws, strict=True)]), theta, covariance)
        for way in (1.0, -1.0)
    ]
    std = np.maximum(*(np.asarray(way["std"]) for way in ways))
    return grid, np.asarray(ways[0]["value"]), np.asarray(ways[1]["value"]), std


def _scatter(before: Model, after: Model, number: int, shown: Sequence[int], other: int | None) -> Scatter:
    """Return residual against the variable of term ``number``, with law ``other`` added to it."""
    term = after.terms[number]
    design = after.design
    joint = _joint_of(after, number)
    described = design.machine.joints[joint]
    variable, unit = _variable(after, number, joint)
    part = after.term_slice(number)
    rows = []
    for index in shown:
        pick = slice(design.bank.half, len(design.segments[index]) - design.bank.half, design.bank.decimation)
        keep = design.blocks[joint][index].keep
        residuals = [full_residual(m.design, m.fit.theta, joint, index, m.extra) for m in (before, after)]
        added = after.contribution(number, joint, index)
        both = added if other is None else added + after.contribution(other, joint, index)
        moved = _signal(after, number, index, joint), np.sign(after.views[index][joint].s), added
        reduced = [design.bank.reduce(own) for own in (*residuals, both)]
        rows.append([own[keep] for own in (*(own[pick] for own in moved), *reduced)])
    x, direction, columns, first, second, own = map(np.concatenate, zip(*rows, strict=True))
    law_x, law_y = _binned(x, columns)
    law_back, law_std = None, np.zeros_like(law_x)
    if other is not None:
        law_x, law_y, law_back, law_std = _both_ways(after, (number, other))
    elif isinstance(term.content, Law):
        curve = spline_curve(term.content, after.fit.theta[part], after.fit.covariance[part, part])
        law_x, law_y, law_std = (np.asarray(curve[key]) for key in ("grid", "value", "std"))
        forth, back = term.content.factor(1.0), term.content.factor(-1.0)
        law_back = None if back == forth else back * law_y
        law_y, law_std = forth * law_y, forth * law_std  # of a law of negative speed there is nothing at positive
    elif term.content.parity is Parity.ODD:
        forth = direction > 0
        law_x, law_y = _binned(x[forth], columns[forth])
        _, law_back = _binned(x[~forth], columns[~forth], law_x)
    return Scatter(
        joint=described.name,
        variable=variable,
        unit=unit,
        x=x,
        before=first,
        after=second,
        law_x=law_x,
        law_y=law_y,
        law_std=law_std,
        effort_unit=effort_unit(described),
        direction=None if law_back is None else direction,
        law_back=law_back,
        partial=second + own,
    )


def worst_place(model: Model, number: int, joint: int) -> dict[str, Any]:
    """Find where along its variable a term acts most on a joint, over the fitted motions.

    ``variable``, ``at`` and ``unit`` locate it: the largest of its mean in thirty bins of the variable. ``friction`` is
    ``more`` or ``less`` there of what turns its sign with the direction of motion, None of anything else.
    """
    content = model.terms[number].content
    odd = content.signed if isinstance(content, Law) else content.parity is Parity.ODD
    x, effort = [], []
    for index in model.fitted:
        own = model.contribution(number, joint, index)
        moving = ~model.design.segments[index].rest[:, joint]
        x.append(_signal(model, number, index, joint)[moving])
        effort.append((own * np.sign(model.views[index][joint].s) if odd else own)[moving])
    grid, mean = _binned(np.concatenate(x), np.concatenate(effort))
    most = int(np.argmax(np.abs(mean) > (1.0 - 1e-9) * np.abs(mean).max()))  # the first of equal ones
    variable, unit = _variable(model, number, joint)
    way = ("more" if mean[most] > 0 else "less") if odd else None
    return {"variable": variable, "at": float(grid[most]), "unit": unit, "friction": way}


def _joint_of(model: Model, number: int) -> int:
    """Return the joint to draw a term on: its own, or where a machine-wide effect is largest."""
    term = model.terms[number]
    if term.joint is not None:
        return term.joint
    sizes = []
    for joint in range(len(model.design.machine.joints)):
        total = sum(float(np.sum(model.contribution(number, joint, index) ** 2)) for index in model.fitted)
        sizes.append(np.sqrt(total) / model.noise.std[joint])
    return int(np.argmax(sizes))


def _followed(term: Term) -> tuple[str, int | None]:
    """Return the signal that a term is drawn against, and the neighbour that has it."""
    if isinstance(term.content, Law):
        return term.content.signal, term.content.other
    return signal_of(term.content.variable, term.shape)


def _variable(model: Model, number: int, joint: int) -> tuple[str, str]:
    """Return what a term is drawn against, and unit, in the words of the signal's joint."""
    joints = model.design.machine.joints
    name, other = _followed(model.terms[number])
    unit = OWN[name][0] if other is None and name in OWN else NEIGHBOUR[name][0]
    words = joint_words(joints[joint if other is None else other])
    own = words.signal(name)
    return (own if other is None else f"{joints[other].name}.{own}"), words.unit(unit)


def _signal(model: Model, number: int, index: int, joint: int) -> FloatArray:
    name, other = _followed(model.terms[number])
    return values_of(model.views[index][joint], name, joint if other is None and name not in OWN else other)


def _binned(x: FloatArray, y: FloatArray, centres: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Average ``y`` in thirty bins of ``x`` (or around given centres): an effect along its variable."""
    if centres is None:
        edges = np.linspace(x.min(), x.max(), 31)
        centres = 0.5 * (edges[1:] + edges[:-1])
    half = (0.5 + 1e-9) * float(centres[1] - centres[0])  # an end is in its bin, however it was rounded
    means = np.array([np.mean(y[np.abs(x - c) <= half]) if np.any(np.abs(x - c) <= half) else np.nan for c in centres])
    good = np.isfinite(means)
    if not good.any():
        return centres, means
    return centres, np.interp(centres, centres[good], means[good])


def worst_seconds(before: Model, after: Model, shown: Sequence[int], floor: Sequence[float]) -> Course:
    """Find the ten seconds and the joint of the largest error before, in noise floors."""
    best: tuple[float, int, int, int] = (-1.0, 0, shown[0], 0)
    design = before.design
    window = max(2, round(10.0 * design.bank.reduced_rate_hz))
    for joint in range(len(design.machine.joints)):
        for index in shown:
            error = effort_residual(design, before.fit.theta, joint, index, before.extra)
            power = (
                np.convolve(error**2, np.ones(window), mode="valid")
                if len(error) > window
                else np.array([np.sum(error**2)])
            )
            start = int(np.argmax(power))
            score = float(power[start]) / max(floor[joint], 1e-12) ** 2
            if score > best[0]:
                best = (score, joint, index, start)
    _, joint, index, start = best
    segment = design.segments[index]
    pick = slice(start, start + window)
    time = segment.t[design.bank.half : len(segment) - design.bank.half : design.bank.decimation][pick]
    r = segment.r[:, joint]
    measured = design.bank.reduce(r * segment.effort[:, joint])[pick]

    def predicted(model: Model) -> FloatArray:
        return measured - effort_residual(model.design, model.fit.theta, joint, index, model.extra)[pick]

    machine_joint = design.machine.joints[joint]
    return Course(machine_joint.name, machine_joint.effort_unit, time, measured, predicted(before), predicted(after))


def friction_curves(before: Model, after: Model) -> tuple[FrictionCurve, ...]:
    """Compute friction against speed of every joint, with its standard deviation's band."""
    curves = []
    parameters = after.design.parameters
    for joint, machine_joint in enumerate(after.design.machine.joints):
        names = tuple(n for n in parameters.drive[joint] if n in _FRICTION)
        part = np.arange(parameters.drive_slice(joint).start, parameters.drive_slice(joint).stop)
        part = part[[n in _FRICTION for n in parameters.drive[joint]]]
        top = max(float(np.abs(after.design.segments[i].v[:, joint]).max()) for i in after.fitted)
        speed = np.concatenate([np.linspace(-top, -1e-9, 60), np.linspace(1e-9, top, 60)])
        columns = drive_columns(names, speed, speed, speed, 0.0)
        std = np.sqrt(np.einsum("ij,jk,ik->i", columns, after.fit.covariance[np.ix_(part, part)], columns).clip(0))
        straight = machine_joint.cylinder is not None or machine_joint.type == "prismatic"
        force = columns @ before.fit.theta[part]
        final = columns @ after.fit.theta[part]
        curves.append(
            FrictionCurve(
                joint=machine_joint.name,
                unit_x="m/s" if straight else "rad/s",
                unit_y=UNITS["f_c"] if straight else "N m",
                speed=speed,
                force=force if after.terms else final,
                std=std,
                after=final if after.terms else None,
            )
        )
    return tuple(curves)


def diagnostics(before: Model, after: Model, shown: Sequence[int]) -> tuple[JointDiagnostics, ...]:
    """Diagnose what is left after the fit, joint by joint: does it depend on its own past, on the motion, on frequency?

    Of the final model on the motions that are shown, segments ``shown`` in a row and correlations never across two of
    them, at the rate of the reduced signals, as ``resid`` of MATLAB's System Identification Toolbox does it. A model
    that lacks nothing leaves correlations within the bound of white noise: the 99 % interval ``2.58 / sqrt(N)`` (Ljung,
    System Identification, 1999, section 16.6). The identification filter itself correlates neighbours where its
    bandwidth is below half the reduced rate.
    """
    return tuple(_diagnosed(before, after, shown, joint) for joint in range(len(after.design.machine.joints)))


def _diagnosed(before: Model, after: Model, shown: Sequence[int], joint: int) -> JointDiagnostics:
    design = after.design
    bank = design.bank
    times, measured, first, second, speeds = [], [], [], [], []
    for index in shown:
        segment = design.segments[index]
        pick = slice(bank.half, len(segment) - bank.half, bank.decimation)
        times.append(segment.t[pick])
        measured.append(bank.reduce(segment.r[:, joint] * segment.effort[:, joint]))
        first.append(effort_residual(before.design, before.fit.theta, joint, index, before.extra))
        second.append(effort_residual(design, after.fit.theta, joint, index, after.extra))
        speeds.append(segment.v[pick, joint])
    rate = bank.reduced_rate_hz
    lags = max(2, min(_LAGS, round(_LONGEST_S * rate), min(len(part) for part in second) // 2))
    auto = correlation(second, second, lags)
    cross = np.concatenate([correlation(speeds, second, lags)[:0:-1], correlation(second, speeds, lags)])
    longest = max(range(len(second)), key=lambda number: len(second[number]))
    frequency, density = _density(second[longest], rate)
    own = design.machine.joints[joint]
    whole = np.concatenate(measured)
    return JointDiagnostics(
        joint=own.name,
        unit=own.effort_unit,
        fit_before=fit_percent(whole, np.concatenate(first)),
        fit_after=fit_percent(whole, np.concatenate(second)),
        time=np.concatenate(times),
        measured=whole,
        before=np.concatenate(first),
        after=np.concatenate(second),
        lag=np.arange(lags) / rate,
        auto=auto,
        cross_lag=np.arange(1 - lags, lags) / rate,
        cross=cross,
        bound=_BOUND / np.sqrt(max(1, sum(len(part) for part in second))),
        frequency=frequency,
        density_before=_density(first[longest], rate)[1],
        density_after=density,
    )


def fit_percent(measured: FloatArray, residual: FloatArray) -> float:
    """Compute 100 (1 - norm(residual) / norm(measured - mean)), %; NaN without motion."""
    size = float(np.linalg.norm(measured - measured.mean()))
    return 100.0 * (1.0 - float(np.linalg.norm(residual)) / size) if size > 0 else float("nan")


def correlation(late: Sequence[FloatArray], early: Sequence[FloatArray], lags: int) -> FloatArray:
    """Correlate ``late`` with ``early`` 0, 1, ... ``lags - 1`` samples before, (lags,), over all segments."""
    one = np.concatenate(late)
    other = np.concatenate(early)
    sizes = float(one.std() * other.std()) * len(one)
    if sizes == 0:
        return np.zeros(lags)
    total = np.zeros(lags)
    for a, b in zip(late, early, strict=True):
        x, y = a - one.mean(), b - other.mean()
        total += [float(x[lag:] @ y[: len(y) - lag]) for lag in range(lags)]
    return total / sizes


def _density(residual: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    frequency, density = scipy.signal.welch(residual, fs=rate, nperseg=min(_WINDOW, len(residual)))
    return frequency[1:], density[1:]
