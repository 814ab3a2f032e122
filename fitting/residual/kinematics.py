"""Two position sensors of one joint against each other: what bends positions, without any dynamics.

The gap between the measured piston position and ``x(q)`` of the measured joint position is zero for a perfect machine.
Effects that bend positions are columns of it, taken at the point that fits best where a formula is not linear; laws are
splines of whatever else was measured. A delay of one sensor against the other, which buses and filters make, shows as
the piston's speed and acceleration: both are part of the base, as nobody's fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from scipy import linalg

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import SITES, DriveView, Effect, Shape, gap_lever, has_both_positions
from fitting.effects.variables import NEIGHBOUR, OWN, parallel_joints
from fitting.regression.design import Design
from fitting.regression.noise import Pairing, moving_stretches
from fitting.residual.laws import Law, varies
from fitting.residual.terms import Model
from fitting.residual.views import Views
from fitting.signals.corrections import Corrections
from fitting.signals.position_sensors import rounded_noise
from fitting.signals.spectrum import Whitening, whitening
from fitting.signals.splines import evaluate, spline_basis, spline_knots

#: Steps of a fit by chords; it ends once one takes less than this of a chi-square of one.
_CHORDS, _LEAST_GAIN = 12, 0.01
#: Values beyond this are no error of a position sensor, m or rad.
_FARTHEST = 1.0
#: Own and neighbours' signals that the gap may be a law of, with the functions of their splines.
_OWN_SIGNALS = {"piston_position": 40, "time": 8, "oil_temperature": 8}
_OTHER_SIGNALS = {"joint_position": 8, "link_angle": 8, "cylinder_force": 8}
_FORCE_FUNCTIONS = 12
#: Share of the variance of a load that its directions have to hold.
_HELD = 0.99
#: Least share of a column that it may be off: a millionth is noise, however large it is.
_LEAST_UNSURE = 1e-6
#: Per joint the white noise and the steps of the joint's sensor, and of its piston's.
SensorErrors = Mapping[int, tuple[tuple[float, float], tuple[float, float]]]


@dataclass(frozen=True)
class GapScore:
    """One shape of an effect with its values on one joint's gap, and the chi-square that it takes beside the others."""

    effect: Effect
    joint: int
    shape: Shape
    gain: float
    values: tuple[float, ...]
    stds: tuple[float, ...]


@dataclass(frozen=True)
class GapLaw:
    """A law of the gap; what gives way to a force sits somewhere (``site``), as an effect of the force does."""

    law: Law
    site: Shape | None = None

    def is_of(self, force: bool) -> bool:
        """Return whether it is of the joint's own force, or else of its own position."""
        return self.site is not None if force else self.law.signal == "piston_position"

    def columns(self, view: DriveView) -> FloatArray:
        """Return columns (N, functions), m."""
        if self.site is None:
            return self.law.columns(view)
        lever = gap_lever(view, self.site)
        bending = lever * view.bending_force(bool(self.site["friction"]))
        return np.asarray(evaluate(np.asarray(self.law.knots), bending) * lever[:, None])


@dataclass(frozen=True)
class GapRows:
    """Gap of one joint where it moves: the whitening of its noise, and the whitened series of each segment.

    A sensor at rest has one value, however often it is read: such rows are no witness.

    Attributes
    ----------
    unsure : of each view changes (N, k) of the load, N, each by one standard deviation of what the base fit leaves
        open; and of the drive's effort
    beside : columns (M, k) of what gives way to a force, with which errors of geometry are fitted where their formulas
        are not linear; None: nothing does
    """

    design: Design
    views: tuple[DriveView, ...]
    whitening: Whitening
    indices: tuple[int, ...]
    unsure: tuple[tuple[FloatArray, ...], ...] = ()
    beside: FloatArray | None = None

    @cached_property
    def joint(self) -> int:
        """The joint's number."""
        return self.views[0].joint

    @cached_property
    def values(self) -> FloatArray:
        """The whitened gap (M,) of all segments."""
        return self.whitened([self.design.segments[i].gap[:, self.joint] for i in self.indices])

    def whitened(self, series: Sequence[FloatArray]) -> FloatArray:
        """Whiten what is beside each segment's gap, (N,) or (N, k) at full rate, as the gap is: (M,), (M, k)."""
        keeps = [self.whitening.kept(self.design.blocks[self.joint][i].keep) for i in self.indices]
        reduce = self.design.bank.reduce
        return np.concatenate([self.whitening(reduce(own))[keep] for own, keep in zip(series, keeps, strict=True)])

    @cached_property
    def zeros(self) -> FloatArray:
        """Columns (M, 2) of a zero that is off: the piston's, and the joint's."""
        return self.whitened(
            [np.column_stack([np.ones(len(view)), view.r / np.max(np.abs(view.r))]) for view in self.views]
        )

    @cached_property
    def base(self) -> FloatArray:
        """Columns (M, 2) of a delay between both sensors."""
        return self.whitened([np.column_stack([view.v, view.a]) for view in self.views])


def gap_rows(
    design: Design, views: Views, fitted: Sequence[int], pairs: Sequence[Pairing], sensors: SensorErrors, joint: int
) -> GapRows:
    """Compute the whitened gap of a joint over the loaded segments; without rows where it hardly moves.

    Its noise is that of (train less repeat), or, without a repeat, what a smooth function of the position leaves; or
    what the sensors' noise and steps make of this motion, if that is more. Steps are the same in two runs of one
    motion, and their difference knows little of them; those of slow motions are not white.
    """
    indices = tuple(i for i in fitted if design.segments[i].loaded)
    own, series = tuple(views[i][joint] for i in indices), list[FloatArray]()
    for pair in pairs:
        a, b = design.segments[pair.train], design.segments[pair.repeat]
        left, right = pair.rows
        difference = (a.gap[left, joint] - b.gap[right, joint]) / np.sqrt(2.0)
        series += moving_stretches(difference, a.rest[left, joint] | b.rest[right, joint], design.bank)
    if not series:
        series = _without_law_of_position(design, indices, joint)
    made, rng = list[FloatArray](), np.random.default_rng(0)
    for view in own:
        errors = [rounded_noise(p, e, rng) for p, e in zip((view.q, view.x), sensors[joint], strict=True)]
        noise = scipy.ndimage.convolve1d(errors[1] - view.r * errors[0], design.bank.value, mode="nearest")
        made += moving_stretches(noise, view.segment.rest[:, joint], design.bank)
    noises = [whitening(parts, design.bank) for parts in (series, made) if parts]
    best = max(noises, key=lambda w: w.std, default=None)
    # Where it hardly moves, its noise is not determined, and nothing is known of the gap.
    return GapRows(design, own, best or whitening([], design.bank), indices if series else ())


def with_forces(rows: GapRows, model: Model) -> GapRows:
    """Return the gap of measured positions, with lever arms and forces of a model that may be fitted at others.

    The drive's effort is the model's and so much of what was measured beyond it as is more than noise.
    """
    joint, left = rows.joint, model.fit.residual[rows.joint]
    share = max(0.0, 1.0 - len(left) / max(float(left @ left), 1e-300))
    views = []
    for index, view in zip(rows.indices, rows.views, strict=True):
        right = model.views[index][joint]
        measured = scipy.ndimage.convolve1d(right.segment.effort[:, joint], view.bank.value, mode="nearest")
        forces = right.forces.copy()
        forces[:, joint] += share * (measured - forces[:, joint])
        segment = replace(view.segment, r=right.segment.r)
        views.append(replace(view, segment=segment, forces=forces, loads=right.loads, cache={}, shared={}))
    first = model.design.parameters.base_slice.start
    return replace(
        rows, views=tuple(views), unsure=tuple(_unsure(model, joint, rows.indices, own) for own in (first, 0))
    )


def _unsure(model: Model, joint: int, indices: Sequence[int], first: int) -> tuple[FloatArray, ...]:
    """Return changes (N, k) of a joint's effort by segment, N: one standard deviation of the base fit each.

    Of parameters from number ``first`` on. The k directions are those that hold nearly all of the effort's variance.
    """
    blocks, p = model.design.blocks[joint], len(model.design.parameters)
    variances, directions = np.linalg.eigh(model.fit.covariance[first:p, first:p])
    theta = np.zeros((p, len(variances)))
    theta[first:] = directions * np.sqrt(np.maximum(variances, 0.0))
    efforts = [np.stack([blocks[i].force(own, first) for own in theta.T], axis=1) for i in indices]
    strength, turned = np.linalg.eigh(np.sum([own.T @ own for own in efforts], axis=0))
    held = np.cumsum(strength[::-1]) / max(float(np.sum(strength)), 1e-300)
    count = int(np.searchsorted(held, _HELD)) + 1
    return tuple(own @ turned[:, ::-1][:, :count] for own in efforts)


def _without_law_of_position(design: Design, indices: Sequence[int], joint: int) -> list[FloatArray]:
    """Estimate the gap's noise without a repeat: what a smooth function of joint position leaves of it."""
    parts = list[FloatArray]()
    for segment in (design.segments[i] for i in indices):
        both = np.column_stack([segment.q[:, joint], segment.gap[:, joint]])
        parts += moving_stretches(both, segment.rest[:, joint], design.bank)
    if not parts:
        return []
    q, gap = np.concatenate(parts).T
    basis = spline_basis(q, 8)
    left = gap - basis @ np.linalg.lstsq(basis, gap, rcond=1e-8)[0]
    return np.split(left, np.cumsum([len(part) for part in parts])[:-1])


def gap_laws(views: Sequence[DriveView]) -> Iterator[GapLaw]:
    """Return the possible laws of the gap where its formula is unknown."""
    machine, joint = views[0].machine, views[0].joint

    def law(signal: str, other: int | None, values: FloatArray, count: int) -> Law | None:
        if not varies(values):
            return None
        return Law(signal, other, False, True, tuple(spline_knots(values, count).tolist()))

    found: list[tuple[Law | None, Shape | None]] = []
    for signal, count in _OWN_SIGNALS.items():
        if signal != "oil_temperature" or all(view.segment.temperature is not None for view in views):
            found.append((law(signal, None, np.concatenate([OWN[signal][1](v) for v in views]), count), None))
    for site in SITES:
        bending = [gap_lever(v, site) * v.bending_force(bool(site["friction"])) for v in views]
        found.append((law("cylinder_force", None, np.concatenate(bending), _FORCE_FUNCTIONS), site))
    for other in (k for k in range(len(machine.joints)) if k != joint):
        for signal, count in _OTHER_SIGNALS.items():
            if signal == "link_angle" and len(parallel_joints(machine, other)) == 1:
                continue  # the joint's own angle
            values = np.concatenate([NEIGHBOUR[signal][1](v, other) for v in views])
            found.append((law(signal, other, values, count), None))
    yield from (GapLaw(own, site) for own, site in found if own is not None)


@dataclass(frozen=True)
class GapColumns:
    """A shape of an effect on the whitened gap.

    Attributes
    ----------
    columns : (M, k) per unit of its parameters
    beyond : (M,) what its formula has beyond them at the values that fit best
    rates : (M, 2) both time derivatives of the first column of what gives way to a force: it has a mode and a damping
        of its own; (M, 0) of all else
    unsure : (M, k) changes of the first column with the load, each by one standard deviation
    """

    effect: Effect
    shape: Shape
    columns: FloatArray
    beyond: FloatArray
    rates: FloatArray
    unsure: FloatArray


def gap_columns(rows: GapRows, effect: Effect, shape: Shape) -> GapColumns | None:
    """Return columns of a shape, its formula at the best-fitting values; None where it bends nothing here."""
    full = [effect.gap_columns(view, shape) for view in rows.views]
    if any(column is None for column in full):
        return None
    columns = [c for c in full if c is not None]
    C, rates = rows.whitened(columns), np.zeros((len(rows.values), 0))
    if effect.between_sensors:
        first = [rows.design.bank.rate(c[:, 0]) for c in columns]
        rates = rows.whitened([np.column_stack([own, rows.design.bank.rate(own)]) for own in first])
    beyond = np.zeros(len(C))
    if type(effect).gap_change is not Effect.gap_change:  # else its columns are all that there is of it
        values, change = _best_point(rows, effect, shape, C)
        beyond = change - C @ values
    return GapColumns(effect, shape, C, beyond, rates, np.zeros((len(C), 0)))


def with_unsure(rows: GapRows, part: GapColumns) -> GapColumns:
    """Add the uncertainty of the first column where only the model knows the force."""
    if not part.effect.between_sensors:
        return part
    friction, changes = bool(part.shape.get("friction")), list[FloatArray]()
    for view, efforts in zip(rows.views, rows.unsure[friction], strict=True):
        plain, own = part.effect.gap_columns(view, part.shape), list[FloatArray]()
        for change in efforts.T:
            changed = (view.forces if friction else view.loads).copy()
            changed[:, rows.joint] += change
            other = replace(view, forces=changed) if friction else replace(view, loads=changed)
            moved = part.effect.gap_columns(other, part.shape)
            assert plain is not None and moved is not None  # it has columns
            own.append(moved[:, 0] - plain[:, 0])
        changes.append(np.stack(own, axis=1))
    # What is alike to the column itself is its value's; of the rest directions that no other has.
    column = part.columns[:, :1] / max(float(np.linalg.norm(part.columns[:, 0])), 1e-300)
    white = rows.whitened(changes)
    directions, sizes, _ = np.linalg.svd(white - column @ (column.T @ white), full_matrices=False)
    kept = sizes > _LEAST_UNSURE * np.linalg.norm(part.columns[:, 0])
    return replace(part, unsure=(directions * sizes)[:, kept])


def _best_point(rows: GapRows, effect: Effect, shape: Shape, C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find the best-fitting values and their change (M,): by chords, with the columns at zero."""
    values, change = np.zeros(C.shape[1]), np.zeros(len(C))
    others = rows.base if rows.beside is None else np.hstack([rows.base, rows.beside])
    scale = np.maximum(np.linalg.norm(C, axis=0), 1e-300)
    pseudo = linalg.pinv(np.hstack([C / scale, others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)]), rtol=1e-5)
    for _ in range(_CHORDS):
        step = (pseudo @ (rows.values - change))[: len(values)] / scale
        trial = values + step
        if not np.all(np.abs(trial) < _FARTHEST):
            break
        try:
            parts = [effect.gap_change(view, shape, trial.tolist()) for view in rows.views]
        except ValueError:  # no linkage has such lengths
            break
        values, change = trial, rows.whitened([c for c in parts if c is not None])
        if float(np.sum((C @ step) ** 2)) < _LEAST_GAIN:
            break
    return values, change


def gap_error(design: Design, indices: Sequence[int], joint: int, explained: Sequence[FloatArray] = ()) -> float:
    """Compute the RMS of the filtered gap where the joint moves, m; without ``explained`` (N,) by segment."""
    values = []
    for number, index in enumerate(i for i in indices if design.segments[i].loaded):
        gap = design.segments[index].gap[:, joint] - (explained[number] if explained else 0.0)
        values.append(design.bank.reduce(gap)[design.blocks[joint][index].keep])
    return float(np.sqrt(np.mean(np.concatenate(values) ** 2))) if sum(map(len, values)) else 0.0


def checkable(machine: Machine) -> tuple[int, ...]:
    """List joints whose kinematics can be checked without dynamics."""
    return tuple(j for j in range(len(machine.joints)) if has_both_positions(machine, j))


def corrected(corrections: Corrections, finding: GapScore) -> Corrections:
    """Rebuild one more finding (or one more step of it) into the corrections."""
    joint = corrections.machine.joints[finding.joint].name
    return finding.effect.apply_to_signals(corrections, joint, finding.shape, finding.values)
