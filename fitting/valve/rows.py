"""From recordings to the rows that a valve is fitted on: command, pressures and measured speed of one axis.

The error is one of speed. What the valve is commanded goes through its non-linearity at the recording's full rate and
through the same two symmetric filters as the position afterwards (:mod:`fitting.signals.filters`); filtering the
command first would move the edges of its dead band.

Rows are left out where something else than the valve decides the speed: the rod within 2 % of its ends, less than 2 bar
in the chamber that is filled (cavitation), less than 3 bar between supply and that chamber, a position that is stale.
Behind a valve that shuts, a chamber below the tank's pressure draws oil through its make-up valve: those too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from daq.errors import InputError, RecordingError
from daq.machine.joints import Cylinder, Joint
from daq.machine.machine_file import Machine
from daq.machine.valves import Valve
from daq.recordings.recording import Recording
from fitting.arrays import BoolArray, FloatArray, IntArray
from fitting.signals.filters import FilterBank, asked_filter_bank, filter_bank
from fitting.signals.position_sensors import piston_of

#: Share of the stroke at each end, pressures in Pa, and periods of the clock as in the module's text.
END_SHARE, CAVITATION, LEAST_DROP, STALE_PERIODS = 0.02, 2e5, 3e5, 2.5
#: Hz; the motion of cranes and excavators ends below it.
BANDWIDTH_HZ = 3.0
#: A filtered row is left out where this share of its filter's weight is: there a speed may be wrong by its whole size.
_TAINTED = 0.03


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
    inlet : (2, N) Pa of head and rod, the sides that are filled while extending, retracting; NaN if not measured
    rates : (2, N) Pa/s of head and rod
    supply, tank : (N,) Pa; NaN where nobody knows
    temperature : (N,) K of the oil, NaN where it is not measured
    taken : (N,) m^3/s that all other cylinders take
    """

    recording: IntArray
    first: IntArray
    clock: FloatArray
    u: FloatArray
    x: FloatArray
    inlet: FloatArray
    rates: FloatArray
    supply: FloatArray
    tank: FloatArray
    temperature: FloatArray
    taken: FloatArray

    def __len__(self) -> int:
        return len(self.u)

    @cached_property
    def parts(self) -> list[slice]:
        """The stretches."""
        edges = [*np.unique(self.first).tolist(), len(self)]
        return [slice(a, b) for a, b in pairwise(edges)]

    @cached_property
    def last_way(self) -> FloatArray:
        """Direction (N,) of the last command, 1 or -1; 0 before the first command of a stretch."""
        last = np.maximum.accumulate(np.where(self.u != 0.0, np.arange(len(self)), -1))
        return np.where(last >= self.first, np.sign(self.u[last]), 0.0)

    @cached_property
    def warm(self) -> bool:
        """True where the oil's temperature is known all along."""
        return bool(np.isfinite(self.temperature).all())


class Counted(Protocol):
    """What states which drops gains are given at and to which commands curves are counted: an axis, as fitted."""

    @property
    def drops(self) -> FloatArray: ...
    @property
    def largest(self) -> tuple[float, float]: ...


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
        """True where both chambers are measured."""
        return bool(np.isfinite(self.signals.inlet).all())

    @cached_property
    def has_supply(self) -> bool:
        """True where the supply pressure is known too."""
        return self.has_pressures and bool(np.isfinite(self.signals.supply).all())

    @cached_property
    def sees_supply(self) -> bool:
        """True where the supply pressure is measured, not declared."""
        return self.has_supply and float(np.ptp(self.signals.supply)) > 0.0

    @property
    def areas(self) -> tuple[float, float]:
        """Areas of head and rod, m^2."""
        return self.cylinder.head_area, self.cylinder.rod_area

    def reduced(self, columns: FloatArray) -> FloatArray:
        """Filter columns (N,) or (N, k) by both filters, by stretch: (M,) or (M, k)."""
        return np.concatenate([self.bank.reduce(columns[part]) for part in self.signals.parts])

    def of(self, recordings: Sequence[int]) -> Axis:
        """Return the same axis with some of the recordings."""
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
    like: Counted | None = None,
) -> Axis:
    """Build rows of one joint's valve.

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
        raise InputError("fitting.joints_no_valve", joint=joint.name)
    if machine.channel("command", joint.name) is None:
        raise InputError("fitting.joints_no_channel_shows", joint=joint.name)
    rate = machine.rate_hz
    if bandwidth_hz is None:
        bank = filter_bank(rate, min(BANDWIDTH_HZ, rate / 5.0))
    else:
        bank = asked_filter_bank(rate, bandwidth_hz, max(recording.duration for recording in recordings))
    pieces: list[_Piece] = []
    for number, recording in enumerate(recordings):
        found = _stretches(machine, joint, recording, number, bank)
        if not found:
            shortest = (2 * (bank.margin + bank.half) + 1) / rate
            raise RecordingError(
                "fitting.no_stretch_without_gap_record", file=recording.file, joint=joint.name, shortest=shortest
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
    signals = Signals(
        recording=np.full(count, number),
        first=np.zeros(count, dtype=np.int64),
        clock=recording.time[part] - recording.time[0],
        u=u,
        x=x,
        inlet=inlet,
        rates=np.stack([bank.rate(own) for own in inlet]),
        supply=supply,
        tank=tank,
        temperature=nothing if oil is None else oil,
        taken=_taken(machine, joint, recording, part, bank),
    )
    usable = _usable(cylinder, signals) & ~_stale(machine, joint, recording)[part]
    weight = np.abs(np.convolve(bank.value, bank.identification))
    tainted = replace(bank, identification=weight / weight.sum()).reduce((~usable).astype(float))
    return signals, bank.reduce(bank.smooth(x)[1]), tainted <= _TAINTED


def _taken(machine: Machine, joint: Joint, recording: Recording, part: slice, bank: FilterBank) -> FloatArray:
    """Compute the flow, m^3/s (N,), of other joints' cylinders with recorded positions."""
    taken = np.zeros(part.stop - part.start)
    for other in machine.joints:
        sensors = [machine.channel(f"{kind}_position", other.name) for kind in ("joint", "piston")]
        known = all(channel is None or channel.name in recording.values for channel in sensors)
        if known and other.name != joint.name and other.cylinder is not None:
            v = bank.rate(piston_of(machine, other, recording)[part])
            taken += np.where(v > 0.0, other.cylinder.head_area, -other.cylinder.rod_area) * v
    return taken


def _usable(cylinder: Cylinder, signals: Signals) -> BoolArray:
    x, u, edge = signals.x, signals.u, END_SHARE * cylinder.stroke
    usable = (x > edge) & (x < cylinder.stroke - edge)
    for own, sign in zip(signals.inlet, (1.0, -1.0), strict=True):
        with np.errstate(invalid="ignore"):  # False where nothing is known
            starved = (sign * u > 0.0) & ((own < CAVITATION) | (signals.supply - own < LEAST_DROP))
            made_up = (u == 0.0) & (signals.last_way == sign) & (own < np.maximum(signals.tank, CAVITATION))
        usable &= ~(starved | made_up)
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
    """Compute median pressure drops at each direction's inlet and outlet, over rows commanded to move."""
    drops, own = np.ones((2, 2)), axis.signals
    for way, sign in enumerate((1.0, -1.0)):
        opened = sign * own.u > 0.1 * max(axis.largest[way], 1e-9)
        for place, drop in enumerate((own.supply - own.inlet[way], own.inlet[1 - way] - own.tank)):
            values = drop[opened & np.isfinite(drop)]
            if len(values):
                drops[way, place] = max(float(np.median(values)), 1e5)
    return drops
