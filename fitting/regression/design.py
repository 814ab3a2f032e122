"""The one linear regression behind stage 1, stage 2 and the loop.

Rows are drive efforts (N at a piston), per joint and reduced sample; columns are every joint's drive parameters,
then the base parameters, then whatever effects were added::

    p1 A1 - p2 A2 - c v  =  D_i(x, v, a) theta_i  +  Y_b(q, q', q'') beta / r_i  +  E eta

so a joint's block only touches its own drive columns, and `unloaded` rows have no base columns. Efforts at the piston
are used, not joint efforts, because their noise is the same at every lever arm.

Generalised least squares: each joint's rows are whitened by the spectrum of its measurement noise and divided by
its innovation's standard deviation, so a residual is a standard normal number, and a sum of squares a chi-square.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.regression.drive import drive_columns, drive_names, known_effort
from fitting.regression.solving import WhiteRows
from fitting.signals.filters import FilterBank
from fitting.signals.lost_rows import hidden
from fitting.signals.preparation import PositionNoise, Segment
from fitting.signals.spectrum import Whitening, unit_whitening

#: A reduced row is dropped when the element rests during more than this share of its filter window. At rest friction is
#: anything between plus and minus the Coulomb friction, which is tens of standard deviations of a row.
REST_SHARE = 0.02
#: And when so much of its weight lies on rows that are made up.
MADE_UP_SHARE = 0.5


@dataclass(frozen=True)
class Parameters:
    """Names of a regression's columns, and where they are: drives' parameters by joint, then the base parameters."""

    joints: tuple[str, ...]
    drive: tuple[tuple[str, ...], ...]
    base: BaseParameters

    @property
    def drives(self) -> tuple[str, ...]:
        """Names of all drive parameters without their joints, in the order of the columns."""
        return tuple(name for names in self.drive for name in names)

    @property
    def drive_count(self) -> int:
        """Number of drive parameters of all joints."""
        return sum(len(names) for names in self.drive)

    def __len__(self) -> int:
        return self.drive_count + len(self.base)

    def drive_slice(self, joint: int) -> slice:
        """Return the place of joint ``joint``'s drive parameters."""
        start = sum(len(names) for names in self.drive[:joint])
        return slice(start, start + len(self.drive[joint]))

    @property
    def base_slice(self) -> slice:
        """Place of the base parameters."""
        return slice(self.drive_count, len(self))

    @property
    def names(self) -> tuple[str, ...]:
        """``joint1.m``, ..., then the base parameters' expressions."""
        drive = [f"{joint}.{name}" for joint, names in zip(self.joints, self.drive, strict=True) for name in names]
        return (*drive, *self.base.expressions)


@dataclass(frozen=True)
class JointBlock:
    """One joint in one segment: full-rate columns, and the same reduced.

    Attributes
    ----------
    target : (N,) at full rate
    known : (N,) effort that the machine file knows (already taken off ``target``)
    used : (k,) places, in order, of the columns that are kept among those of all ``width`` parameters; the rest is zero
    own : (N, k) columns of ``used`` at full rate
    reduced_target, own_reduced : the same through the identification filter, (M,), (M, k)
    keep : (M,) False where the element rests
    """

    target: FloatArray
    known: FloatArray
    used: IntArray
    width: int
    own: FloatArray
    reduced_target: FloatArray
    own_reduced: FloatArray
    keep: BoolArray

    @property
    def columns(self) -> FloatArray:
        """Columns of all parameters at full rate, (N, p)."""
        return self.wide(self.own)

    @property
    def reduced(self) -> FloatArray:
        """Columns of all parameters through the filter, (M, p)."""
        return self.wide(self.own_reduced)

    def wide(self, own: FloatArray) -> FloatArray:
        """Widen columns (M, k) of ``used`` to all parameters, (M, p)."""
        wide = np.zeros((len(own), self.width))
        wide[:, self.used] = own
        return wide

    def force(self, theta: FloatArray, first: int = 0) -> FloatArray:
        """Compute the drive's effort by parameters from number ``first`` on, (N,); ``theta`` (p,) or longer."""
        start = int(np.searchsorted(self.used, first))
        return np.asarray(self.own[:, start:] @ theta[self.used[start:]])

    def effort(self, bank: FilterBank, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return target (M,) and columns (M, k) of ``used`` as joint efforts at lever arm ``r`` (N,), filtered."""
        both = bank.reduce(np.column_stack([self.target, self.own]) * r[:, None])
        return both[:, 0], both[:, 1:]


@dataclass(frozen=True)
class Design:
    """All blocks of a set of segments; ``blocks[joint][segment]``.

    ``stored`` means that recordings are long, and segments and blocks read their arrays from a file when asked
    (:mod:`fitting.regression.stored`): whatever has a row for every sample is then to be worked on segment by segment.
    """

    machine: Machine
    parameters: Parameters
    bank: FilterBank
    noise: tuple[PositionNoise, ...]
    segments: tuple[Segment, ...]
    blocks: tuple[tuple[JointBlock, ...], ...]
    stored: bool = False

    @property
    def numbers(self) -> int:
        """Count of numbers in all columns."""
        return sum(block.own.size + block.own_reduced.size for blocks in self.blocks for block in blocks)

    def indices(self, *roles: str) -> tuple[int, ...]:
        """Return the indices of the segments with one of these roles."""
        return tuple(i for i, segment in enumerate(self.segments) if segment.role in roles)

    def kept(self, noise: NoiseModel, joint: int, index: int) -> BoolArray:
        """Return which whitened rows of a joint in a segment have only moving samples in their past."""
        return noise.of(joint, self.segments[index].loaded).kept(self.blocks[joint][index].keep)

    def white(self, noise: NoiseModel, joint: int, index: int, rows: FloatArray) -> FloatArray:
        """Whiten and scale reduced rows of one joint in one segment; those that are kept."""
        return noise.of(joint, self.segments[index].loaded)(rows)[self.kept(noise, joint, index)]


#: Puts a segment and its blocks of all joints where they are to stay.
Store = Callable[[Segment, list[JointBlock]], tuple[Segment, list[JointBlock]]]


def build_design(
    machine: Machine,
    base: BaseParameters,
    bank: FilterBank,
    noise: Sequence[PositionNoise],
    segments: Iterable[Segment],
    store: Store | None = None,
) -> Design:
    """Build columns of every joint in every segment; of a segment and blocks, what ``store`` returns is kept."""
    names = drive_names(machine)
    parameters = Parameters(tuple(j.name for j in machine.joints), names, base)
    kept, rows = [], []
    for segment in segments:
        row = _blocks(machine, parameters, bank, noise, segment)
        if store is not None:
            segment, row = store(segment, row)
        kept.append(segment)
        rows.append(row)
    return Design(
        machine,
        parameters,
        bank,
        tuple(noise),
        tuple(kept),
        tuple(tuple(row[joint] for row in rows) for joint in range(len(machine.joints))),
        store is not None,
    )


def with_efforts(design: Design, segments: Sequence[Segment], joints: Collection[int]) -> Design:
    """Return a design with ``segments`` unlike those of ``design`` in when some joints' efforts were sampled.

    Blocks of the other joints are those of ``design`` itself.
    """
    bank, blocks = design.bank, list(design.blocks)
    for joint in joints:
        width, own = len(design.parameters.drive[joint]), []
        for segment, before in zip(segments, design.blocks[joint], strict=True):
            drive = drive_columns_of(design.parameters, segment, joint, design.noise[joint].sign)
            target = segment.effort[:, joint] - before.known
            both = bank.reduce(np.column_stack([target, drive]))
            columns = np.hstack([drive, before.own[:, width:]])
            reduced = np.hstack([both[:, 1:], before.own_reduced[:, width:]])
            own.append(replace(before, target=target, own=columns, reduced_target=both[:, 0], own_reduced=reduced))
        blocks[joint] = tuple(own)
    return replace(design, segments=tuple(segments), blocks=tuple(blocks))


def with_targets(design: Design, segments: Sequence[Segment]) -> Design:
    """Return a design with ``segments`` unlike those of ``design`` in what the efforts are, not in their times."""
    blocks = []
    for joint, before in enumerate(design.blocks):
        own = []
        for segment, block in zip(segments, before, strict=True):
            target = segment.effort[:, joint] - block.known
            own.append(replace(block, target=target, reduced_target=design.bank.reduce(target)))
        blocks.append(tuple(own))
    return replace(design, segments=tuple(segments), blocks=tuple(blocks))


def _blocks(
    machine: Machine, parameters: Parameters, bank: FilterBank, noise: Sequence[PositionNoise], segment: Segment
) -> list[JointBlock]:
    """Build the blocks of all joints in one segment."""
    body = None
    if segment.loaded:
        speeds = np.array([own.sign for own in noise])
        body = base_regressor(machine, parameters.base, segment.q, segment.qd, segment.qdd, speed_noise=speeds)
        body /= segment.r[:, :, None]
    blocks = []
    for number, joint in enumerate(machine.joints):
        drive = parameters.drive_slice(number)
        used = np.arange(drive.start, drive.stop)
        columns = drive_columns_of(parameters, segment, number, noise[number].sign)
        if body is not None:
            carried = np.flatnonzero(np.any(body[:, number] != 0, axis=0))
            used = np.append(used, parameters.base_slice.start + carried)
            columns = np.hstack([columns, body[:, number, carried]])
        external = None if segment.external is None else segment.external[:, number]
        known = known_effort(joint, segment.v[:, number], segment.a[:, number], external)
        target = segment.effort[:, number] - known
        keep = moving_rows(bank, segment.rest[:, number]) & measured_rows(bank, segment)
        keep &= joint.cylinder is not None or segment.loaded
        reduced = bank.reduce(np.column_stack([target, columns]))
        own = reduced[:, 0], reduced[:, 1:]
        blocks.append(JointBlock(target, known, used, len(parameters), columns, *own, keep))
    return blocks


def drive_columns_of(parameters: Parameters, segment: Segment, joint: int, speed_noise: float) -> FloatArray:
    """Compute columns (N, k) of a joint's drive parameters in one segment, signs expected under ``speed_noise``."""
    x, v, a = segment.x[:, joint], segment.v[:, joint], segment.a[:, joint]
    late = segment.late[joint] if segment.late else 0.0
    return drive_columns(parameters.drive[joint], x, v, a, speed_noise, late)


def moving_rows(bank: FilterBank, rest: BoolArray) -> BoolArray:
    """Return reduced rows (M,) with next to no rest (N,) in their filter window."""
    return np.abs(bank.reduce(rest.astype(float))) < REST_SHARE


def measured_rows(bank: FilterBank, segment: Segment) -> BoolArray:
    """Return reduced rows (M,) without values made up where a gap hides something of the band."""
    if segment.bridged is None:
        return np.ones(bank.rows(len(segment)), dtype=bool)
    return np.abs(bank.reduce(hidden(segment.bridged, bank.decimation).astype(float))) < MADE_UP_SHARE


@dataclass(frozen=True)
class NoiseModel:
    """Measurement noise of each joint's reduced effort.

    While rods are unpinned no link moves, so what restless positions make of inertia is not in the efforts: on the slew
    of a crane that is nearly all of the noise.

    Attributes
    ----------
    whitenings : per joint the whitening of its noise, in drive effort unit
    measured : True if it comes from a repeated motion, False if it had to be estimated from residuals
    unloaded : the same of `unloaded` recordings; none where it is not known, and taken for that of the others
    """

    whitenings: tuple[Whitening, ...]
    measured: bool
    unloaded: tuple[Whitening, ...] = ()

    @property
    def std(self) -> FloatArray:
        """Standard deviation of the noise after the identification filter, (n,), drive effort unit."""
        return np.array([w.std for w in self.whitenings])

    def of(self, joint: int, loaded: bool) -> Whitening:
        """Return the whitening of one joint's noise, with links or without."""
        return (self.unloaded if self.unloaded and not loaded else self.whitenings)[joint]


def white_noise_model(joints: int) -> NoiseModel:
    """Return unit white noise for every joint: an iteration's start, and ordinary least squares."""
    return NoiseModel(tuple(unit_whitening() for _ in range(joints)), False)


@dataclass(frozen=True)
class Extra:
    """Effect columns added to a design: ``columns[joint][segment]`` at full rate, (N, k), None where they are zero.

    ``expected`` (r, k) are rows of unit noise around zero, of what is known of their parameters before any data.
    """

    names: tuple[str, ...]
    columns: Sequence[Sequence[FloatArray | None]]
    expected: FloatArray | None = None

    def expected_rows(self, parameters: int) -> tuple[WhiteRows, ...]:
        """Return what is expected beside so many other ``parameters``, a block of its own; none without."""
        if self.expected is None:
            return ()
        A = np.hstack([np.zeros((len(self.expected), parameters)), self.expected])
        return (WhiteRows(A, np.zeros(len(A)), ()),)

    def beside(
        self, columns: FloatArray, bank: FilterBank, joint: int, index: int, r: FloatArray | None = None
    ) -> FloatArray:
        """Put the effects' columns beside reduced ``columns`` (M, p) of a joint in a segment, times ``r`` (N,)."""
        if not self.names:
            return columns
        own = self.columns[joint][index]
        if own is None:
            return np.hstack([columns, np.zeros((len(columns), len(self.names)))])
        return np.hstack([columns, bank.reduce(own if r is None else own * r[:, None])])


def whitened(
    design: Design, noise: NoiseModel, fitted: Sequence[int], extra: Extra | None = None
) -> tuple[WhiteRows, ...]:
    """Whiten rows of every joint over the fitted segments."""
    return tuple(whitened_joint(design, noise, joint, fitted, extra) for joint in range(len(design.machine.joints)))


def whitened_joint(
    design: Design, noise: NoiseModel, joint: int, fitted: Sequence[int], extra: Extra | None = None
) -> WhiteRows:
    """Whiten rows of one joint over the fitted segments."""
    width = len(design.parameters) + (0 if extra is None else len(extra.names))
    parts_A, parts_b, sections = [np.zeros((0, width))], [np.zeros(0)], []
    for index in fitted:
        block = design.blocks[joint][index]
        columns = block.reduced if extra is None else extra.beside(block.reduced, design.bank, joint, index)
        kept, whiten = design.kept(noise, joint, index), noise.of(joint, design.segments[index].loaded)
        parts_A.append(whiten(columns)[kept])
        parts_b.append(whiten(block.reduced_target)[kept])
        sections.append((index, kept))
    return WhiteRows(np.vstack(parts_A), np.concatenate(parts_b), tuple(sections))


def full_residual(design: Design, theta: FloatArray, joint: int, index: int, extra: Extra | None = None) -> FloatArray:
    """Compute the residual of a joint's drive effort in a segment, measured minus predicted, (N,), unfiltered."""
    block = design.blocks[joint][index]
    residual = block.target - block.force(theta)
    own = None if extra is None else extra.columns[joint][index]
    return residual if own is None else residual - own @ theta[len(design.parameters) :]


def reduced_residual(
    design: Design, theta: FloatArray, joint: int, index: int, extra: Extra | None = None
) -> FloatArray:
    """Filter :func:`full_residual` for identification, (M,)."""
    block = design.blocks[joint][index]
    residual = block.reduced_target - block.own_reduced @ theta[block.used]
    own = None if extra is None else extra.columns[joint][index]
    return residual if own is None else residual - design.bank.reduce(own @ theta[len(design.parameters) :])


def reduced_errors(
    design: Design, theta: FloatArray, joint: int, indices: Sequence[int], extra: Extra | None = None
) -> FloatArray:
    """Join :func:`reduced_residual` of a joint over moving rows of some segments, at least one, all in a row."""
    blocks = design.blocks[joint]
    return np.concatenate([reduced_residual(design, theta, joint, i, extra)[blocks[i].keep] for i in indices])


def effort_residual(
    design: Design, theta: FloatArray, joint: int, index: int, extra: Extra | None = None
) -> FloatArray:
    """Compute the residual of a joint's effort, measured minus predicted, N m or N, filtered, (M,)."""
    r = design.segments[index].r[:, joint]
    if not design.stored:
        return design.bank.reduce(r * full_residual(design, theta, joint, index, extra))
    block = design.blocks[joint][index]
    target, columns = block.effort(design.bank, r)
    residual = target - columns @ theta[block.used]
    own = None if extra is None else extra.columns[joint][index]
    return residual if own is None else residual - design.bank.reduce(r * (own @ theta[len(design.parameters) :]))


def predicted_effort(
    design: Design, theta: FloatArray, joint: int, index: int, extra: Extra | None = None
) -> FloatArray:
    """Predict the drive effort of a joint in a segment, (N,), known part included: ``F^``."""
    block = design.blocks[joint][index]
    return block.target + block.known - full_residual(design, theta, joint, index, extra)


def effort_errors(
    design: Design, theta: FloatArray, indices: Sequence[int], extra: Extra | None = None
) -> tuple[FloatArray, ...]:
    """Compute per joint the filtered effort error (N m or N) over moving rows, all segments in a row."""
    return moving_efforts(design, indices, lambda joint, index: effort_residual(design, theta, joint, index, extra))


def moving_efforts(
    design: Design, indices: Sequence[int], of: Callable[[int, int], FloatArray]
) -> tuple[FloatArray, ...]:
    """Collect per joint what ``of`` gives of it and each loaded segment, (M,), over moving rows, all in a row."""
    result = []
    for joint, blocks in enumerate(design.blocks):
        parts = [of(joint, index)[blocks[index].keep] for index in indices if design.segments[index].loaded]
        result.append(np.concatenate(parts) if parts else np.zeros(0))
    return tuple(result)
