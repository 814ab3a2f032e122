"""The machine file (schema ``hilfit/machine/1``): the one description of an arm, its cylinders and its channels.

:func:`load_machine` is its only parser. Unknown keys, wrong units and machines that cannot exist are refused
with one line that names the place.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
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
from daq.joints import Coupling, Cylinder, DenavitHartenberg, Drive, Interval, Joint, Limits, ordered, unique
from daq.linkages import ThreePin
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
    "Coupling",
    "Cylinder",
    "DenavitHartenberg",
    "Drive",
    "Hydraulics",
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
    "motor_position",
    "motor_effort",
    "external_force",
    "oil_temperature",
    "supply_pressure",
    "tank_pressure",
    "base_roll",
    "base_pitch",
]
JOINT_QUANTITIES = frozenset(
    {
        "joint_position",
        "piston_position",
        "head_pressure",
        "rod_pressure",
        "cylinder_force",
        "joint_effort",
        "motor_position",
        "motor_effort",
        "external_force",
    }
)


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
        return None if value is None else ordered(value, "range")

    @field_validator("source", mode="before")
    @classmethod
    def _kind_of_source(cls, value: Any) -> Any:
        return source_of(value)


class Simulation(FileModel):
    """Present only in files that the simulator writes: how machine time relates to the clock on the wall."""

    speed: Annotated[float, Field(gt=0, le=4)] = 1.0  # machine seconds per second
    lockstep: bool = True  # machine time advances with SYNC and by nothing else


class Hydraulics(FileModel):
    """What the supply can do, for motions that are planned: pressures in Pa, flow in m^3/s."""

    supply_pressure: Annotated[float, Field(gt=0)] | None = None  # Pa: no chamber gets above it
    tank_pressure: Annotated[float, Field(ge=0)] = 0.0  # Pa: the chamber that is emptied keeps at least this
    pump_flow: Annotated[float, Field(gt=0)] | None = None  # m^3/s, all cylinders together

    @model_validator(mode="after")
    def _supply_above_tank(self) -> Hydraulics:
        if self.supply_pressure is not None and self.supply_pressure <= self.tank_pressure:
            raise ValueError(
                f"supply_pressure {self.supply_pressure:g} Pa must be above tank_pressure {self.tank_pressure:g} Pa"
            )
        return self


class Machine(FileModel):
    """A validated machine file."""

    schema_: Literal["hilfit/machine/1"] = Field(alias="schema")
    name: Name
    rate_hz: Annotated[float, Field(gt=0, le=10_000)] = 50.0
    gravity: tuple[float, float, float]  # m/s^2 in the base frame
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]
    buses: tuple[Bus, ...] = ()
    hydraulics: Hydraulics | None = None
    simulation: Simulation | None = None

    @model_validator(mode="after")
    def _hangs_together(self) -> Machine:
        names = [joint.name for joint in self.joints]
        unique(names, "joint")
        unique([channel.name for channel in self.channels], "channel")
        buses = {bus.name: bus for bus in self.buses}
        unique([bus.name for bus in self.buses], "bus")
        for index, channel in enumerate(self.channels):
            place = f"channels[{index}] ({channel.name})"
            if channel.quantity in JOINT_QUANTITIES:
                if channel.joint is None:
                    raise ValueError(f"{place}: a {channel.quantity} belongs to a joint; add joint:")
                if channel.joint not in names:
                    hint = did_you_mean(channel.joint, names) or f"; there are {', '.join(names)}"
                    raise ValueError(f"{place}: there is no joint '{channel.joint}'{hint}")
                self._has(place, channel.quantity, self.joint(channel.joint))
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
        self._couplings_are_joints()
        for name in names:
            self._joint_is_measured(name)
        if not np.all(np.linalg.svd(self._turned_by_motors(), compute_uv=False) > 1e-9):
            name = next(joint.name for joint in self.joints if joint.drive is not None and joint.drive.coupled)
            raise ValueError(
                f"joints.{name}: drive: all motors together do not tell the joints' positions; correct ratio, coupled"
            )
        return self

    @staticmethod
    def _has(place: str, quantity: str, joint: Joint) -> None:
        """A channel's joint has what the channel measures."""
        motor = quantity in ("motor_position", "motor_effort")
        if motor and joint.drive is None:
            raise ValueError(f"{place}: {joint.name} has no drive, so no {quantity}; add drive: with its ratio")
        if not motor and quantity not in ("joint_position", "joint_effort"):
            if joint.cylinder is None:
                raise ValueError(f"{place}: {joint.name} has no cylinder, so no {quantity}")
            if joint.cylinder.vented is not None and quantity == f"{joint.cylinder.vented}_pressure":
                raise ValueError(f"{place}: this chamber of {joint.name} is vented; remove the channel, or vented:")

    def _couplings_are_joints(self) -> None:
        names = [joint.name for joint in self.joints]
        for joint in self.joints:
            for coupling in () if joint.drive is None else joint.drive.coupled:
                if coupling.joint == joint.name:
                    raise ValueError(f"joints.{joint.name}: drive.coupled names the joint itself; that is ratio")
                if coupling.joint not in names:
                    hint = did_you_mean(coupling.joint, names) or f"; there are {', '.join(names)}"
                    raise ValueError(f"joints.{joint.name}: drive.coupled: there is no joint '{coupling.joint}'{hint}")

    @property
    def ratios(self) -> npt.NDArray[np.float64]:
        """``R`` (n, n) with ``q_motor = R q`` and ``tau = R' tau_motor``; 1 for a joint without a ``drive``."""
        R = np.eye(len(self.joints))
        places = {joint.name: number for number, joint in enumerate(self.joints)}
        for row, joint in enumerate(self.joints):
            if joint.drive is not None:
                R[row, row] = joint.drive.ratio
                for coupling in joint.drive.coupled:
                    R[row, places[coupling.joint]] = coupling.ratio
        return R

    @property
    def at_motors(self) -> tuple[int, ...]:
        """Numbers of the joints whose position only their motor tells."""
        return tuple(
            number
            for number, joint in enumerate(self.joints)
            if joint.drive is not None and self.channel("joint_position", joint.name) is None
        )

    def _turned_by_motors(self) -> npt.NDArray[np.float64]:
        """Part of ``R`` that has to be inverted to know the joints' positions, each row by its own ratio."""
        unknown = list(self.at_motors)
        R = self.ratios[np.ix_(unknown, unknown)]
        return np.asarray(R / np.diag(R)[:, None])

    def _joint_is_measured(self, name: str) -> None:
        present = [c.quantity for c in self.channels if c.joint == name]
        for quantity in sorted(set(present)):
            if present.count(quantity) > 1:
                raise ValueError(f"joints.{name}: has more than one {quantity} channel; keep one")
        positions = {"joint_position", "piston_position", "motor_position"}
        if not positions & set(present):
            kinds = "joint_position or " + ("motor_position" if self.joint(name).drive else "piston_position")
            raise ValueError(f"joints.{name}: has no position; add a channel of quantity {kinds}")
        pressures = {"head_pressure", "rod_pressure"} & set(present)
        cylinder = self.joint(name).cylinder
        if cylinder is not None and cylinder.vented is not None and pressures:
            return
        if "external_force" in present and len(pressures) < 2:
            raise ValueError(f"joints.{name}: an external_force needs head_pressure and rod_pressure; add them")
        if self.joint(name).drive is not None and "joint_effort" not in present:
            self._joint_is_driven(name)
            return
        if len(pressures) == 1 and not {"cylinder_force", "joint_effort"} & set(present):
            missing = ({"head_pressure", "rod_pressure"} - pressures).pop()
            raise ValueError(f"joints.{name}: has no effort: one pressure is not enough; add a {missing} channel")
        if not pressures and not {"cylinder_force", "joint_effort"} & set(present):
            raise ValueError(
                f"joints.{name}: has no effort; add head_pressure and rod_pressure, cylinder_force, or joint_effort"
            )

    def _joint_is_driven(self, name: str) -> None:
        """Every motor that acts on the joint is measured."""
        column = [joint.name for joint in self.joints].index(name)
        for row in np.flatnonzero(self.ratios[:, column]):
            motor = self.joints[row].name
            if self.channel("motor_effort", motor) is None:
                raise ValueError(
                    f"joints.{name}: has no effort; add a channel of quantity joint_effort, or motor_effort of {motor}"
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
        raise MachineFileError(
            f"{name}{line}: not valid YAML: {problem}; docs/machine-file.md shows a whole file"
        ) from None
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
