"""From recordings to the rows that a valve is fitted on: command, pressures and measured speed of one axis.

The error is one of speed. What the valve is told goes through its non-linearity at the recording's full rate and
through the same two symmetric filters as the position afterwards (:mod:`fitting.signals.filters`); filtering the
command first would move the edges of its dead band.

Rows are left out where something else than the valve decides the speed: the rod within 2 % of its ends, less than 2 bar
in the chamber that is filled (cavitation), less than 3 bar between supply and that chamber, a position that is stale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from daq.errors import InputError, RecordingError
from daq.machine.joints import Cylinder, Joint
from daq.machine.machine_file import Machine
from daq.machine.valves import Valve
from daq.recordings.recording import Recording
from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.signals.filters import FilterBank, filter_bank
from fitting.signals.position_sensors import piston_weight

#: Share of the stroke at each end, pressures in Pa, and periods of the clock as in the module's text.
END_SHARE, CAVITATION, LEAST_DROP, STALE_PERIODS = 0.02, 2e5, 3e5, 2.5
#: Hz; the motion of cranes and excavators ends below it.
BANDWIDTH_HZ = 3.0
#: A filtered row of which this share of the filter's weight stands on rows to be left out is left out.
_TAINTED = 0.1


@dataclass(frozen=True)
class Signals:
    """What was measured of an axis at full rate: ``N`` samples of all stretches, one behind the other.

    Attributes
    ----------
    recording : (N,) number of the recording among those that were read together
    first : (N,) place of the first sample of the stretch that each sample is in
    clock : (N,) s since the recording's first row
    u : (N,) command less neutral over the farthest command there is, positive extends
    x : (N,) piston position, m
    inlet, outlet : (2, N) Pa at the side that is filled and emptied while extending, retracting; NaN if not measured
    rates : (2, N) Pa/s of head and rod
    supply, tank : (N,) Pa; NaN where nobody knows
    temperature : (N,) K of the oil, NaN where it is not measured
    usable : (N,) False where something else than the valve decides the speed
    """

    recording: IntArray
    first: IntArray
    clock: FloatArray
    u: FloatArray
    x: FloatArray
    inlet: FloatArray
    outlet: FloatArray
    rates: FloatArray
    supply: FloatArray
    tank: FloatArray
    temperature: FloatArray
    usable: BoolArray

    def __len__(self) -> int:
        return len(self.u)

    @property
    def pressures(self) -> tuple[FloatArray, FloatArray]:
        """Pressures (N,) of head and rod."""
        return self.inlet[0], self.inlet[1]

    @cached_property
    def parts(self) -> list[slice]:
        """The stretches."""
        edges = [*np.unique(self.first).tolist(), len(self)]
        return [slice(a, b) for a, b in pairwise(edges)]

    @cached_property
    def last_way(self) -> FloatArray:
        """Which way (N,) it was told to go last, 1 or -1; 0 before the first command of a stretch."""
        place = np.where(self.u != 0.0, np.arange(len(self)), -1)
        last = np.maximum.accumulate(place)
        return np.where(last >= self.first, np.sign(self.u[last]), 0.0)

    @cached_property
    def warm(self) -> bool:
        """Whether the oil's temperature is known all along."""
        return bool(np.isfinite(self.temperature).all())


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis and what was recorded of it; ``M`` filtered and decimated rows.

    Attributes
    ----------
    joint, cylinder, valve : as the machine file has them
    bank : filters; its ``identification`` kernel is both filters in one
    signals : at full rate
    speed : (M,) m/s, measured, positive extends
    keep : (M,) rows of which nothing is to be left out
    recordings : (M,) number of each row's recording
    drops : (2, 2) Pa, median of p_s - p_in and p_out - p_tank while extending, retracting: what gains are given at;
        1 where not measured
    largest : (2,) largest command of each direction that was recorded, as ``u`` is: what curves are counted to
    """

    joint: Joint
    cylinder: Cylinder
    valve: Valve
    bank: FilterBank
    signals: Signals
    speed: FloatArray
    keep: BoolArray
    recordings: IntArray
    drops: FloatArray
    largest: tuple[float, float]

    @cached_property
    def has_pressures(self) -> bool:
        """Whether both chambers are measured."""
        return bool(np.isfinite(self.signals.inlet).all())

    @cached_property
    def has_supply(self) -> bool:
        """Whether the supply pressure is known too."""
        return self.has_pressures and bool(np.isfinite(self.signals.supply).all())

    @cached_property
    def sees_supply(self) -> bool:
        """Whether the supply pressure is measured, not declared."""
        return self.has_supply and float(np.ptp(self.signals.supply)) > 0.0

    @property
    def areas(self) -> tuple[float, float]:
        """Areas of head and rod, m^2."""
        return self.cylinder.head_area, self.cylinder.rod_area

    def reduced(self, columns: FloatArray) -> FloatArray:
        """Columns (N,) or (N, k) through both filters, stretch by stretch: (M,) or (M, k)."""
        return np.concatenate([self.bank.reduce(columns[part]) for part in self.signals.parts])

    def of(self, recordings: Sequence[int]) -> Axis:
        """The same axis, some of the recordings."""
        own = np.isin(self.signals.recording, recordings)
        rows = np.isin(self.recordings, recordings)
        cut = {
            field.name: getattr(self.signals, field.name)[..., own]
            for field in fields(Signals)
            if field.name != "first"
        }
        moved = np.cumsum(~own)[self.signals.first[own]]
        signals = Signals(first=self.signals.first[own] - moved, **cut)
        return replace(
            self, signals=signals, speed=self.speed[rows], keep=self.keep[rows], recordings=self.recordings[rows]
        )


def axis_of(
    machine: Machine,
    joint: Joint,
    recordings: Sequence[Recording],
    *,
    bandwidth_hz: float | None = None,
    like: Axis | None = None,
) -> Axis:
    """Rows of one joint's valve.

    Parameters
    ----------
    bandwidth_hz : cut-off of the filter; :data:`BANDWIDTH_HZ`, or a fifth of a slower rate
    like : the same axis in recordings that were fitted: whose reference drops and largest commands a model is of

    Raises
    ------
    InputError
        If the machine file has no valve or no command for this joint, or a recording no stretch for the filter.
    """
    cylinder = joint.cylinder
    if cylinder is None or cylinder.valve is None:
        raise InputError(f"joints.{joint.name}: has no valve; add cylinder.valve: and a channel of quantity command")
    if machine.channel("command", joint.name) is None:
        raise InputError(f"joints.{joint.name}: no channel shows its valve's command; add one of quantity command")
    rate = machine.rate_hz
    wanted = min(BANDWIDTH_HZ, rate / 5.0) if bandwidth_hz is None else bandwidth_hz
    if not 0 < wanted <= rate / 5.0:
        raise InputError(f"--bandwidth {wanted:g}: must be above 0 and at most a fifth of the rate, {rate / 5.0:g} Hz")
    bank = filter_bank(rate, wanted)
    pieces: list[_Piece] = []
    for number, recording in enumerate(recordings):
        found = _stretches(machine, joint, recording, number, bank)
        if not found:
            shortest = (2 * (bank.margin + bank.half) + 1) / rate
            raise RecordingError(
                f"{recording.file}: {joint.name}: no stretch of {shortest:.1f} s without a gap; record again or raise "
                "the bandwidth"
            )
        pieces += found
    whole = replace(bank, identification=np.convolve(bank.value, bank.identification))
    signals, start = [], 0
    for own, _, _ in pieces:
        signals.append(replace(own, first=np.full(len(own), start)))
        start += len(own)
    joined = {f.name: np.concatenate([getattr(own, f.name) for own in signals], axis=-1) for f in fields(Signals)}
    axis = Axis(
        joint=joint,
        cylinder=cylinder,
        valve=cylinder.valve,
        bank=whole,
        signals=Signals(**joined),
        speed=np.concatenate([speed for _, speed, _ in pieces]),
        keep=np.concatenate([keep for _, _, keep in pieces]),
        recordings=np.concatenate([np.full(len(speed), own.recording[0]) for own, speed, _ in pieces]),
        drops=np.ones((2, 2)),
        largest=(max(0.0, float(joined["u"].max())), max(0.0, float(-joined["u"].min()))),
    )
    if like is not None:
        return replace(axis, drops=like.drops, largest=like.largest)
    return replace(axis, drops=_drops(axis))


#: A stretch: what was measured, measured speed, and rows to keep.
_Piece = tuple[Signals, FloatArray, BoolArray]


def _stretches(machine: Machine, joint: Joint, recording: Recording, number: int, bank: FilterBank) -> list[_Piece]:
    names = [
        c.name
        for c in machine.channels
        if c.joint == joint.name or (c.joint is None and c.quantity in ("supply_pressure", "tank_pressure"))
    ]
    names = [name for name in names if name in recording.values]
    least = 2 * (bank.margin + bank.half) + 1
    parts = [part for part in recording.segments(names) if part.stop - part.start >= least]
    return [_stretch(machine, joint, recording, number, part, bank) for part in parts]


def _stretch(
    machine: Machine, joint: Joint, recording: Recording, number: int, part: slice, bank: FilterBank
) -> _Piece:
    cylinder, count = joint.cylinder, part.stop - part.start
    assert cylinder is not None and cylinder.valve is not None
    valve, nothing = cylinder.valve, np.full(part.stop - part.start, np.nan)

    def values(quantity: str, own: str | None) -> FloatArray | None:
        channel = machine.channel(quantity, own)
        return None if channel is None or channel.name not in recording.values else recording.values[channel.name][part]

    def chamber(side: str) -> FloatArray:
        port = values(f"{side}_port_pressure", joint.name)
        measured = values(f"{side}_pressure", joint.name) if port is None else port
        if measured is None and cylinder.vented == side:
            return np.zeros(count)
        return nothing if measured is None else measured

    command = values("command", joint.name)
    assert command is not None
    u = valve.extends * (command - valve.neutral) / valve.full
    x = piston_of(machine, joint, recording)[part]
    inlet = np.stack([chamber("head"), chamber("rod")])
    supply = values("supply_pressure", None)
    if supply is None:
        supply = np.full(count, np.nan if machine.supplied_at is None else machine.supplied_at)
    tank = values("tank_pressure", None)
    if tank is None:
        tank = np.full(count, 0.0 if machine.hydraulics is None else machine.hydraulics.tank_pressure)
    oil = values("oil_temperature", None)
    usable = _usable(cylinder, u, x, inlet, supply) & ~_stale(machine, joint, recording)[part]
    speed = bank.reduce(bank.smooth(x)[1])
    weight = np.abs(np.convolve(bank.value, bank.identification))
    tainted = replace(bank, identification=weight / weight.sum()).reduce((~usable).astype(float))
    signals = Signals(
        recording=np.full(count, number),
        first=np.zeros(count, dtype=np.int64),
        clock=recording.time[part] - recording.time[0],
        u=u,
        x=x,
        inlet=inlet,
        outlet=inlet[::-1],
        rates=np.stack([bank.rate(own) for own in inlet]),
        supply=supply,
        tank=tank,
        temperature=nothing if oil is None else oil,
        usable=usable,
    )
    return signals, speed, tainted <= _TAINTED


def piston_of(machine: Machine, joint: Joint, recording: Recording) -> FloatArray:
    """Piston position (N,) of a joint, m: of both sensors where there are two, each by its noise.

    Where the joint's sensor puts the rod somewhere else by a constant, that changes no speed.
    """
    assert joint.cylinder is not None
    angle, piston = (machine.channel(q, joint.name) for q in ("joint_position", "piston_position"))
    found = []
    if angle is not None:
        found.append(joint.cylinder.linkage.piston_position(recording.values[angle.name]))
    if piston is not None:
        found.append(recording.values[piston.name])
    if len(found) == 1:
        return np.asarray(found[0], dtype=float)
    weight = piston_weight(machine, joint, recording)
    return np.asarray((1.0 - weight) * found[0] + weight * found[1])


def _usable(cylinder: Cylinder, u: FloatArray, x: FloatArray, inlet: FloatArray, supply: FloatArray) -> BoolArray:
    edge = END_SHARE * cylinder.stroke
    usable = (x > edge) & (x < cylinder.stroke - edge)
    for own, told in zip(inlet, (u > 0, u < 0), strict=True):
        with np.errstate(invalid="ignore"):
            starved = (own < CAVITATION) | (supply - own < LEAST_DROP)  # False where nothing is known
        usable &= ~(told & starved)
    return np.asarray(usable)


def _stale(machine: Machine, joint: Joint, recording: Recording) -> BoolArray:
    stale = np.zeros(len(recording), dtype=bool)
    for quantity in ("joint_position", "piston_position"):
        channel = machine.channel(quantity, joint.name)
        if channel is not None and channel.name in recording.age:
            with np.errstate(invalid="ignore"):
                stale |= recording.age[channel.name] > STALE_PERIODS / recording.rate_hz
    return stale


def _drops(axis: Axis) -> FloatArray:
    """Median pressure drops at inlet and outlet of each direction, over rows in which the valve is told to move."""
    drops, own = np.ones((2, 2)), axis.signals
    for way, sign in enumerate((1.0, -1.0)):
        told = sign * own.u > 0.1 * max(axis.largest[way], 1e-9)
        for place, drop in enumerate((own.supply - own.inlet[way], own.outlet[way] - own.tank)):
            values = drop[told & np.isfinite(drop)]
            if len(values):
                drops[way, place] = max(float(np.median(values)), 1e5)
    return drops
