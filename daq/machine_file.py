"""The machine file (schema ``hilfit/machine/1``): the one description of an arm, its cylinders and its channels.

:func:`load_machine` is its only parser. Unknown keys, wrong units and machines that cannot exist are refused
with one line that names the place.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from daq.buses import (
    Bus,
    CanNode,
    CanopenBus,
    CanSource,
    FileModel,
    ModbusRtuBus,
    ModbusSource,
    ModbusTcpBus,
    Name,
    OtherBus,
    OtherSource,
    Source,
    source_of,
)
from daq.errors import MachineFileError
from daq.linkages import Linkage, ThreePin
from daq.machine_file_errors import did_you_mean, one_line
from daq.units import SI_UNITS, Conversion, conversion

__all__ = [
    "JOINT_QUANTITIES",
    "SCHEMA",
    "Bus",
    "CanNode",
    "CanSource",
    "CanopenBus",
    "Channel",
    "Cylinder",
    "DenavitHartenberg",
    "Joint",
    "Limits",
    "Machine",
    "ModbusRtuBus",
    "ModbusSource",
    "ModbusTcpBus",
    "OtherBus",
    "OtherSource",
    "Quantity",
    "Simulation",
    "Source",
    "load_machine",
    "machine_to_yaml",
    "parse_machine",
]

SCHEMA = "hilfit/machine/1"

Quantity = Literal[
    "joint_position",
    "piston_position",
    "head_pressure",
    "rod_pressure",
    "cylinder_force",
    "joint_effort",
    "oil_temperature",
    "supply_pressure",
    "tank_pressure",
    "base_roll",
    "base_pitch",
]
JOINT_QUANTITIES = frozenset(
    {"joint_position", "piston_position", "head_pressure", "rod_pressure", "cylinder_force", "joint_effort"}
)
Positive = Annotated[float, Field(gt=0)]
Interval = tuple[float, float]


def _ordered(interval: Interval, what: str) -> Interval:
    if interval[0] >= interval[1]:
        raise ValueError(f"{what} must go from low to high, not {interval[0]:g} to {interval[1]:g}")
    return interval


class DenavitHartenberg(FileModel):
    """Standard (distal) Denavit-Hartenberg row: ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``; the joint variable adds."""

    a: float  # m
    alpha: float  # rad
    d: float  # m
    theta: float  # rad


class Limits(FileModel):
    """What the joint may do: position (rad or m), speed and acceleration."""

    position: Interval
    velocity: Positive
    acceleration: Positive

    @field_validator("position")
    @classmethod
    def _position(cls, value: Interval) -> Interval:
        return _ordered(value, "position")


class Cylinder(FileModel):
    """A hydraulic cylinder and the linkage between its rod and the joint."""

    bore: Positive  # m
    rod: Annotated[float, Field(ge=0)]  # m; 0 never occurs on a real single-rod cylinder but is a plunger
    stroke: Positive  # m
    damping: Annotated[float, Field(ge=0)] = 0.0  # N s/m, known; 0: then it is part of f_v
    moving_mass: Annotated[float, Field(gt=0)] | None = None  # kg if known, else identified
    linkage: Linkage

    @model_validator(mode="after")
    def _rod_fits(self) -> Cylinder:
        if self.rod >= self.bore:
            raise ValueError(f"rod {self.rod:g} m must be thinner than the bore {self.bore:g} m")
        return self

    @property
    def head_area(self) -> float:
        """A1 in m^2."""
        return float(np.pi * self.bore**2 / 4)

    @property
    def rod_area(self) -> float:
        """A2, the annulus on the rod side, in m^2."""
        return float(np.pi * (self.bore**2 - self.rod**2) / 4)


class Joint(FileModel):
    """One joint, from base to tip."""

    name: Name
    type: Literal["revolute", "prismatic"] = "revolute"
    dh: DenavitHartenberg
    limits: Limits
    cylinder: Cylinder | None = None

    @property
    def effort_unit(self) -> str:
        """``N m`` for a revolute joint, ``N`` for a prismatic one."""
        return "N m" if self.type == "revolute" else "N"

    @model_validator(mode="after")
    def _linkage_closes(self) -> Joint:
        if self.cylinder is None:
            return self
        linkage, stroke = self.cylinder.linkage, self.cylinder.stroke
        q = np.linspace(*self.limits.position, 201)
        x = linkage.piston_position(q)
        if isinstance(linkage, ThreePin):
            shortest, longest = abs(linkage.a - linkage.b), linkage.a + linkage.b
            if linkage.retracted >= longest or linkage.retracted + stroke <= shortest:
                raise ValueError(
                    f"cylinder.linkage cannot close: the pins are {shortest:.4g} to {longest:.4g} m apart, the "
                    f"cylinder {linkage.retracted:.4g} to {linkage.retracted + stroke:.4g} m; check a, b, retracted"
                )
        if x.max() <= 0 or x.min() >= stroke:
            raise ValueError(
                f"cylinder.linkage cannot close: within limits.position the piston would have to be at {x.min():.4g}"
                f" to {x.max():.4g} m of a stroke of {stroke:g} m; check retracted, offset or zero"
            )
        if np.any(np.diff(x) >= 0) and np.any(np.diff(x) <= 0):
            raise ValueError(
                "cylinder.linkage passes a dead centre within limits.position (the lever arm becomes zero); "
                "narrow the limits or correct offset"
            )
        tolerance = 1e-6 + 1e-3 * stroke
        if x.min() < -tolerance or x.max() > stroke + tolerance:
            raise ValueError(
                f"cylinder.stroke {stroke:g} m is exceeded: limits.position needs {x.min():.4g} to {x.max():.4g} m; "
                "narrow limits.position or correct the linkage"
            )
        return self


class Channel(FileModel):
    """One measured signal: its quantity, unit and, where it is acquired, its source."""

    name: Name
    quantity: Quantity
    joint: str | None = None
    unit: str
    range: Interval | None = None  # in `unit`; values at or beyond it are saturated
    noise_std: Annotated[float, Field(ge=0)] | None = None  # in `unit`
    resolution: Annotated[float, Field(ge=0)] | None = None  # in `unit`
    source: Source | None = None

    @field_validator("range")
    @classmethod
    def _range(cls, value: Interval | None) -> Interval | None:
        return None if value is None else _ordered(value, "range")

    @field_validator("source", mode="before")
    @classmethod
    def _kind_of_source(cls, value: Any) -> Any:
        return source_of(value)


class Simulation(FileModel):
    """Present only in files that the simulator writes: how machine time relates to the clock on the wall."""

    speed: Annotated[float, Field(gt=0, le=4)] = 1.0  # machine seconds per second
    lockstep: bool = True  # machine time advances with SYNC and by nothing else


class Machine(FileModel):
    """A validated machine file."""

    schema_: Literal["hilfit/machine/1"] = Field(alias="schema")
    name: Name
    rate_hz: Annotated[float, Field(gt=0, le=10_000)] = 50.0
    gravity: tuple[float, float, float]  # m/s^2 in the base frame
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]
    buses: tuple[Bus, ...] = ()
    simulation: Simulation | None = None

    @model_validator(mode="after")
    def _hangs_together(self) -> Machine:
        names = [joint.name for joint in self.joints]
        _unique(names, "joint")
        _unique([channel.name for channel in self.channels], "channel")
        buses = {bus.name: bus for bus in self.buses}
        _unique([bus.name for bus in self.buses], "bus")
        for index, channel in enumerate(self.channels):
            place = f"channels[{index}] ({channel.name})"
            if channel.quantity in JOINT_QUANTITIES:
                if channel.joint is None:
                    raise ValueError(f"{place}: a {channel.quantity} belongs to a joint; add joint:")
                if channel.joint not in names:
                    hint = did_you_mean(channel.joint, names) or f"; there are {', '.join(names)}"
                    raise ValueError(f"{place}: there is no joint '{channel.joint}'{hint}")
                if (
                    channel.quantity not in ("joint_position", "joint_effort")
                    and self.joint(channel.joint).cylinder is None
                ):
                    raise ValueError(f"{place}: {channel.joint} has no cylinder, so no {channel.quantity}")
            elif channel.joint is not None:
                raise ValueError(f"{place}: a {channel.quantity} belongs to the machine; remove joint:")
            try:
                self.conversion(channel)
            except ValueError as error:
                raise ValueError(f"{place}: {error}") from None
            if channel.source is not None and self.buses:
                bus = buses.get(channel.source.bus)
                if bus is None:
                    known = list(buses)
                    hint = did_you_mean(channel.source.bus, known) or f"; there are {', '.join(known)}"
                    raise ValueError(f"{place}: there is no bus '{channel.source.bus}'{hint}")
                fitting = {"canopen": CanSource, "modbus_tcp": ModbusSource, "modbus_rtu": ModbusSource}
                if not isinstance(channel.source, fitting.get(bus.type, OtherSource)):
                    raise ValueError(f"{place}: its source does not fit bus '{bus.name}' of type {bus.type}")
        for name in names:
            self._joint_is_measured(name)
        return self

    def _joint_is_measured(self, name: str) -> None:
        present = [c.quantity for c in self.channels if c.joint == name]
        for quantity in sorted(set(present)):
            if present.count(quantity) > 1:
                raise ValueError(f"joints.{name}: has more than one {quantity} channel; keep one")
        if not {"joint_position", "piston_position"} & set(present):
            raise ValueError(
                f"joints.{name}: has no position; add a channel of quantity joint_position or piston_position"
            )
        pressures = {"head_pressure", "rod_pressure"} & set(present)
        if len(pressures) == 1 and not {"cylinder_force", "joint_effort"} & set(present):
            missing = ({"head_pressure", "rod_pressure"} - pressures).pop()
            raise ValueError(f"joints.{name}: has no effort: one pressure is not enough; add a {missing} channel")
        if not pressures and not {"cylinder_force", "joint_effort"} & set(present):
            raise ValueError(
                f"joints.{name}: has no effort; add head_pressure and rod_pressure, cylinder_force, or joint_effort"
            )

    def joint(self, name: str) -> Joint:
        """The joint of that name (KeyError if there is none)."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise KeyError(name)

    def channel(self, quantity: str, joint: str | None = None) -> Channel | None:
        """The channel that measures ``quantity`` (of ``joint``), or None."""
        for channel in self.channels:
            if channel.quantity == quantity and channel.joint == joint:
                return channel
        return None

    def si_unit(self, channel: Channel) -> str:
        """The SI unit of a channel's quantity; for joint positions and efforts the type of joint decides."""
        si = SI_UNITS[channel.quantity]
        if channel.joint is not None and self.joint(channel.joint).type == "prismatic":
            si = {"joint_position": "m", "joint_effort": "N"}.get(channel.quantity, si)
        return si

    def conversion(self, channel: Channel) -> Conversion:
        """Conversion from the channel's declared unit to SI."""
        return conversion(channel.unit, self.si_unit(channel))


def _unique(names: list[str], what: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{what} '{name}' is there {names.count(name)} times; names must differ")


def load_machine(path: str | Path) -> Machine:
    """Read and validate a machine file.

    Raises
    ------
    MachineFileError
        With one line: file, line, key, what is wrong and what to do.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MachineFileError(f"{path}: no such file; give the path of a machine file (YAML)") from None
    except IsADirectoryError:
        raise MachineFileError(f"{path}: is a directory; give the machine file itself (YAML)") from None
    except UnicodeDecodeError:
        raise MachineFileError(f"{path}: is not a text file; give a machine file (YAML)") from None
    except OSError as error:
        raise MachineFileError(f"{path}: cannot be read ({error.strerror}); give a machine file (YAML)") from None
    if "\0" in text:  # binary content may happen to be valid UTF-8
        raise MachineFileError(f"{path}: is not a text file; give a machine file (YAML)")
    return parse_machine(text, name=str(path))


def parse_machine(text: str, name: str = "machine file") -> Machine:
    """Validate the text of a machine file; ``name`` is what errors call it."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        problem = " ".join(str(getattr(error, "problem", None) or "cannot be parsed").split())
        raise MachineFileError(f"{name}{line}: not valid YAML: {problem}") from None
    if not isinstance(content, dict):
        raise MachineFileError(f"{name}: not a machine file; it must start with 'schema: {SCHEMA}'")
    if content.get("schema") != SCHEMA:
        found = content.get("schema")
        raise MachineFileError(f"{name}: schema is {found!r}; this version reads '{SCHEMA}'")
    try:
        return Machine.model_validate(content)
    except ValidationError as error:
        raise MachineFileError(one_line(name, tree, error, _ALL_KEYS)) from None


def machine_to_yaml(machine: Machine) -> str:
    """The machine as the text of a machine file; :func:`parse_machine` reads it back unchanged."""
    content = machine.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=False)
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


_MODELS: tuple[type[BaseModel], ...] = (*FileModel.__subclasses__(), ThreePin)
_ALL_KEYS = sorted({field.alias or key for model in _MODELS for key, field in model.model_fields.items()})
