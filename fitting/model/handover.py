"""From a finished identification to the model that it hands over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from daq.errors import HilfitError
from fitting.arrays import FloatArray
from fitting.estimators.effort_fit import EffortRows
from fitting.loop.session import Session
from fitting.loop.weighting import weighed
from fitting.model import motion
from fitting.model.arm_model import ArmModel, Pass, Provenance, Seen, Source
from fitting.model.evaluation import Evaluated
from fitting.model.export.tracing.tracing import untraced
from fitting.model.prediction import BAND
from fitting.model.tails import Tail
from fitting.model.uses.overload import learn
from fitting.regression.design import Design, effort_errors, effort_residual, full_residual
from fitting.residual.laws import Law
from fitting.residual.terms import Model, extra_columns, fit_model
from fitting.residual.views import RodLaw, SegmentViews, Views, rod_laws

#: Seconds of each recording that what is usual is learnt from.
_LEARN_S = 600.0
#: Moments of the validation recordings that are kept at most.
_SEEN = 240
#: Seconds whose errors are so many interquartile ranges beyond the usual are left out of the spread, up to this share.
_FAR_OUT, _MOST_OUT = 3.0, 0.1


def hand_over(
    session: Session, steps: Sequence[Mapping[str, Any]], final: Model, report: Mapping[str, Any]
) -> ArmModel:
    """Return the model of a session.

    Parameters
    ----------
    session : the identification's data
    steps : the kinematic corrections that the final fit is on, as JSON
    final : the final fit
    report : content of ``report.json``: when, by which software, on what data, with which verdict
    """
    model = ArmModel(
        machine=session.described,
        steps=tuple(dict(step) for step in steps),
        base=session.base,
        bandwidth_hz=final.design.bank.bandwidth_hz,
        noise=final.design.noise,
        temperature=_temperature(final),
        provenance=Provenance(
            created=report["created"],
            software=dict(report["software"]),
            data=tuple(Source(d["role"], d["file"], d["sha256"], d["samples"]) for d in report["data"]),
            verdict=report["loop"]["verdict"],
        ),
        **_fit(final),
    )
    rests = []
    for lost in {untraced(model), motion.histories(model) | motion.heated(model)} - {frozenset()}:
        terms = [term for number, term in enumerate(final.terms) if number not in lost]
        own = weighed(fit_model(final.design, final.noise, final.fitted, terms, session.prior), session.prior).model
        rests.append(replace(model, **_fit(own)))
    seen, coverage = _seen(final), _coverage(model, final)
    return replace(model, rests=tuple(rests), seen=seen, coverage=coverage, tails=_tails(model, session))


def _temperature(final: Model) -> tuple[float, float] | None:
    """Return coldest and warmest oil of the fitted recordings, K."""
    oil = [final.design.segments[index].temperature for index in final.fitted]
    known = [own[np.isfinite(own)] for own in oil if own is not None]
    values = np.concatenate(known) if known else np.empty(0)
    return (float(values.min()), float(values.max())) if len(values) else None


def _fit(final: Model) -> dict[str, Any]:
    """Return the content of a fit."""
    design = final.design
    loaded = [i for i in final.fitted if design.segments[i].loaded] or list(final.fitted)
    hidden = np.zeros(len(final.fit.theta)) if final.fit.hidden is None else final.fit.hidden
    spread = np.array([_spread(final, joint, loaded) for joint in range(len(design.blocks))])
    # A law does not hold at positions that it was not fitted to.
    known = not any(isinstance(term.content, Law) for term in final.terms)
    if known and not final.fit.whitened and not design.stored and final.prior is not None:
        more = EffortRows(design, final.fitted, final.extra).elsewhere(final.prior, final.fit.theta)
        spread = np.sqrt(spread**2 + more)
    errors = effort_errors(design, final.fit.theta, design.indices("validate"), final.extra)
    return {
        "terms": final.terms,
        "passes": _passes(final),
        "covariance": final.fit.covariance - np.diag(hidden),
        "hidden": hidden if hidden.any() else None,
        "told": final.fit.determined,
        "residual_std": spread,
        "errors": np.array([np.sqrt(np.mean(own**2)) if len(own) else np.nan for own in errors]),
    }


def _coverage(model: ArmModel, final: Model) -> FloatArray:
    """Compute the share (n,) of moving validation samples in the 95 % band."""
    found, inside, count = Evaluated(model, final.design, final.extra, {}), np.zeros(len(model.joints)), 0
    for index in final.design.indices("validate"):
        segment = final.design.segments[index]
        held = np.abs(segment.effort - found.drive_effort(index)) <= BAND * found.std(index)
        inside = inside + np.sum(held & ~segment.rest, axis=0)
        count = count + np.sum(~segment.rest, axis=0)
    return np.asarray(inside / np.where(count, count, np.nan))


def _seen(final: Model) -> Seen | None:
    """Sample moments of the validation recordings, evenly."""
    design, bank, parts = final.design, final.design.bank, list[list[FloatArray]]()
    joints = range(len(design.blocks))
    for index in (i for i in design.indices("validate") if design.segments[i].loaded):
        segment = design.segments[index]
        place = slice(bank.half, len(segment) - bank.half, bank.decimation)
        error = [effort_residual(design, final.fit.theta, joint, index, final.extra) for joint in joints]
        moved = [own[place] for own in (segment.q, segment.qd, segment.qdd)]
        parts.append([*moved, bank.reduce(segment.r * segment.effort), np.column_stack(error)])
    rows = [np.vstack(own) for own in zip(*parts, strict=True)]
    if not rows or not len(rows[0]):
        return None
    return Seen(*(own[:: -(-len(own) // _SEEN)] for own in rows))


def _tails(model: ArmModel, session: Session) -> tuple[Tail, ...] | None:
    """Fit scores' tails on the identification's recordings; None where these are too few."""
    most = round(_LEARN_S * model.machine.rate_hz)
    seen = [own.cut(slice(0, min(len(own), most))) for own in session.recordings if own.role != "unloaded"]
    try:
        return learn(replace(model, machine=session.machine), seen)  # their channels are those at the joints
    except HilfitError:
        return None


def _passes(final: Model) -> tuple[Pass, ...]:
    """Return the fits that led to the final one; where no column holds a force, the last alone."""
    design = final.design
    chain = final.earlier if any(term.uses_model for term in final.terms) else ()
    extra, passes = extra_columns(design, (), ()), list[Pass]()
    for theta in chain:
        views = SegmentViews(design, theta, final.fitted, extra)
        passes.append(Pass(theta, views[0][0].ranges, _rods(design, final.fitted, views)))
        extra = extra_columns(design, views, final.terms)
    views = SegmentViews(design, final.fit.theta, final.fitted, final.extra)
    return (*passes, Pass(final.fit.theta, views[0][0].ranges, _rods(design, final.fitted, views)))


def _rods(design: Design, fitted: Sequence[int], views: Views) -> tuple[RodLaw | None, ...]:
    """Return the laws of loaded segments: a model has its machine's links."""
    return rod_laws(design, fitted, lambda index: views[index][0].forces)[True]


def _spread(final: Model, joint: int, indices: Sequence[int]) -> float:
    """Compute the RMS of a joint's drive effort error while it moves, single seconds aside."""
    rate = final.design.bank.rate_hz
    seconds: list[FloatArray] = []
    for index in indices:
        error = full_residual(final.design, final.fit.theta, joint, index, final.extra)
        moving = error[~final.design.segments[index].rest[:, joint]]
        seconds += np.array_split(moving, max(round(len(moving) / rate), 1)) if len(moving) else []
    usual = without_single(seconds)
    return float(np.sqrt(np.mean(np.concatenate(usual) ** 2))) if usual else 0.0


def without_single(seconds: Sequence[FloatArray]) -> list[FloatArray]:
    """Drop errors of seconds far larger than usual: an event in one of them (a knock, rods that were not on yet) is no
    measure of all others, and would widen every band.

    A second is far out where the logarithm of its root mean square is more than three interquartile ranges above the
    upper quartile (J. W. Tukey, *Exploratory Data Analysis*, 1977: "far out"). An error that differs from pose to pose
    has a large range of its own, so nothing of it is left out; and where more than a tenth are far out, that is no
    incident but what the model is like, and all are kept.
    """
    sizes = np.array([0.5 * np.log(np.mean(own**2) + 1e-300) for own in seconds])
    if not len(sizes):
        return []
    low, high = np.percentile(sizes, [25, 75])
    far = sizes > high + _FAR_OUT * (high - low)
    return [own for own, out in zip(seconds, far, strict=True) if not out or far.mean() > _MOST_OUT]
