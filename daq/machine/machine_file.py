"""The machine file (schema ``hilfit/machine/1``): the one description of an arm, its cylinders and its channels.

:func:`load_machine` is its only parser. Unknown keys, wrong units and machines that cannot exist are refused
with one line that names the place.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import yaml
from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator

from daq import safe_yaml
from daq.arrays import FloatArray
from daq.errors import BadValueError, MachineFileError
from daq.machine.buses import (
    Bus,
    CanBus,
    CanNode,
    CanopenBus,
    CanSignalsBus,
    CanSource,
    FileModel,
    KnownDelay,
    ModbusRtuBus,
    ModbusSource,
    ModbusTcpBus,
    Name,
    OtherBus,
    OtherSource,
    SignalSource,
    Source,
    source_of,
)
from daq.machine.coherence import IncoherenceError, incoherences
from daq.machine.joints import (
    Convention,
    Coupling,
    Cylinder,
    DenavitHartenberg,
    Drive,
    Interval,
    Joint,
    Limits,
    ordered,
)
from daq.machine.machine_file_errors import Problem, all_problems, short
from daq.machine.quantities import JOINT_QUANTITIES, SENT_QUANTITIES, Quantity
from daq.machine.valves import Supply, Valve
from daq.messages import Sentence, first_of
from daq.units import AS_SENT, Conversion, conversion, kept_as_sent, si_unit

__all__ = [
    "JOINT_QUANTITIES", "SCHEMA", "Bus", "CanBus", "CanNode", "CanSignalsBus", "CanSource", "CanopenBus", "Channel",
    "Coupling", "Cylinder", "DenavitHartenberg", "Drive", "Hydraulics", "Joint", "KnownDelay", "Limits", "Machine",
    "ModbusRtuBus", "ModbusSource", "ModbusTcpBus", "OtherBus", "OtherSource", "Quantity", "SignalSource",
    "Simulation", "Source", "Supply", "Valve", "load_machine", "machine_to_yaml", "parse_machine",
]  # fmt: skip

SCHEMA = "hilfit/machine/1"


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
    patience_s: Annotated[float, Field(gt=0, le=60)] = 2.0  # in lockstep, for a device that answered just now


class Hydraulics(FileModel):
    """What the supply can do, for motions that are planned: pressures in Pa, flow in m^3/s."""

    supply_pressure: Annotated[float, Field(gt=0)] | None = None  # Pa: no chamber gets above it
    tank_pressure: Annotated[float, Field(ge=0)] = 0.0  # Pa: the chamber that is emptied keeps at least this
    pump_flow: Annotated[float, Field(gt=0)] | None = None  # m^3/s, all cylinders together

    @model_validator(mode="after")
    def _supply_above_tank(self) -> Hydraulics:
        if self.supply_pressure is not None and self.supply_pressure <= self.tank_pressure:
            raise BadValueError(
                "daq.supply_pressure_pa_must_above",
                at=("supply_pressure",),
                supply_pressure=self.supply_pressure,
                tank_pressure=self.tank_pressure,
            )
        return self


class Machine(FileModel):
    """A validated machine file."""

    schema_: Literal["hilfit/machine/1"] = Field(alias="schema")
    name: Name
    rate_hz: Annotated[float, Field(gt=0, le=10_000)] = 50.0
    gravity: tuple[float, float, float]  # m/s^2 in the base frame
    convention: Convention = "standard"  # of the joints' Denavit-Hartenberg rows
    joints: Annotated[tuple[Joint, ...], Field(min_length=1)]
    channels: Annotated[tuple[Channel, ...], Field(min_length=1)]
    buses: tuple[Bus, ...] = ()
    delays: tuple[KnownDelay, ...] = ()  # between buses: a prior of the fit
    hydraulics: Hydraulics | None = None
    supply: Supply | None = None  # in front of the valves
    simulation: Simulation | None = None

    @model_validator(mode="after")
    def _hangs_together(self) -> Machine:
        located = incoherences(self)
        if located:
            raise IncoherenceError(located)
        return self

    @property
    def ratios(self) -> FloatArray:
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
        """Numbers of the joints whose position only their motor measures."""
        return tuple(
            number
            for number, joint in enumerate(self.joints)
            if joint.drive is not None and self.channel("joint_position", joint.name) is None
        )

    @property
    def turning_at_motors(self) -> tuple[int, ...]:
        """Numbers of the joints whose velocity only their motor measures."""
        return tuple(
            number
            for number, joint in enumerate(self.joints)
            if self.channel("joint_velocity", joint.name) is None and self.channel("motor_velocity", joint.name)
        )

    def joint(self, name: str) -> Joint:
        """Return the joint of that name (KeyError if there is none)."""
        for joint in self.joints:
            if joint.name == name:
                return joint
        raise KeyError(name)

    def channel(self, quantity: str, joint: str | None = None) -> Channel | None:
        """Return the channel that measures ``quantity`` (of ``joint``), or None."""
        for channel in self.channels:
            if channel.quantity == quantity and channel.joint == joint:
                return channel
        return None

    @property
    def supplied_at(self) -> float | None:
        """Pa: the supply pressure that the file declares, or None."""
        declared = None if self.supply is None else self.supply.pressure
        return declared or (None if self.hydraulics is None else self.hydraulics.supply_pressure)

    @property
    def pump_limit(self) -> float | None:
        """m^3/s: the flow that the file declares for all cylinders together, or None."""
        declared = None if self.supply is None else self.supply.flow_limit
        return declared or (None if self.hydraulics is None else self.hydraulics.pump_flow)

    def unseen_pistons(self) -> list[str]:
        """List cylinder joints whose piston no channel shows once its rod is off the pin."""
        return [j.name for j in self.joints if j.cylinder is not None and not self.channel("piston_position", j.name)]

    def si_unit(self, channel: Channel) -> str:
        """Return the SI unit of a channel's quantity; the joint's type decides for positions and efforts.

        Commands and spool positions keep the unit that they are sent in.
        """
        if channel.quantity in SENT_QUANTITIES and channel.unit in AS_SENT:
            return channel.unit
        joint = None if channel.joint is None else self.joint(channel.joint)
        return si_unit(channel.quantity, straight=joint is not None and joint.type == "prismatic")

    def conversion(self, channel: Channel) -> Conversion:
        """Return the conversion from the channel's declared unit to SI."""
        if channel.quantity in SENT_QUANTITIES:
            return kept_as_sent(channel.unit)
        return conversion(channel.unit, self.si_unit(channel))


def load_machine(path: str | Path) -> Machine:
    """Read and validate a machine file.

    Raises
    ------
    MachineFileError
        With one line: file, line, key, what is wrong and what to do.
    """
    return parse_machine(read_machine_text(Path(path)), name=str(path), folder=Path(path).absolute().parent)


def read_machine_text(path: Path) -> str:
    """Read the text of a machine file; MachineFileError if there is none."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise MachineFileError("daq.no_such_file_give", path=path) from None
    except IsADirectoryError:
        raise MachineFileError("daq.machine_file_is_directory", path=path) from None
    except UnicodeDecodeError:
        raise MachineFileError("daq.not_text_file", path=path) from None
    except OSError as error:
        raise MachineFileError("daq.cannot_read", path=path, reason=error.strerror) from None
    if "\0" in text:  # binary content may happen to be valid UTF-8
        raise MachineFileError("daq.not_text_file", path=path)
    return text


def parse_machine(text: str, name: str = "machine file", folder: Path | None = None) -> Machine:
    """Validate the text of a machine file; ``name`` is what errors call it, ``folder`` where files it names begin."""
    machine, problems = machine_problems(text, folder)
    if machine is None:
        raise MachineFileError(first_of([problem.under(name) for problem in problems]))
    return machine


def machine_problems(text: str, folder: Path | None = None) -> tuple[Machine | None, list[Problem]]:
    """Return the machine of a file's text, or None and its problems, the most significant first."""
    tree, content, problem = content_of(text)
    return machine_of(tree, content, folder) if problem is None else (None, [problem])


def content_of(text: str) -> tuple[yaml.Node | None, dict[str, Any], Problem | None]:
    """Return nodes and content of a file's text, and a problem if it is no machine file of this schema at all."""
    try:
        tree, content = safe_yaml.read(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        why = " ".join(str(getattr(error, "problem", None) or "cannot be parsed").split())
        what = Sentence("daq.not_valid_yaml", problem=why)
        return None, {}, Problem(None if mark is None else mark.line + 1, "", what)
    if not isinstance(content, dict):
        return tree, {}, Problem(None, "", Sentence("daq.not_machine_file", schema=SCHEMA))
    if (found := content.get("schema")) != SCHEMA:
        what = Sentence("daq.machine_file_schema", found=short(repr(found)), schema=SCHEMA)
        return tree, content, Problem(None, "", what)
    return tree, content, None


def machine_of(
    tree: yaml.Node | None, content: dict[str, Any], folder: Path | None
) -> tuple[Machine | None, list[Problem]]:
    """Return the machine of a file's content, or None and its problems, the most significant first."""
    try:
        return Machine.model_validate(content, context={"folder": folder}), []
    except ValidationError as error:
        return None, all_problems(tree, error, _ALL_KEYS, _TAGS)


def machine_to_yaml(machine: Machine) -> str:
    """Write the machine as machine file text; :func:`parse_machine` reads it back unchanged."""
    return safe_yaml.write(machine_content(machine))


def machine_content(machine: Machine) -> dict[str, Any]:
    """Return the machine as the content of a machine file."""
    return machine.model_dump(mode="json", by_alias=True, exclude_none=True, exclude_defaults=False)


def _kinds(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for kind in model.__subclasses__():
        yield kind
        yield from _kinds(kind)


_MODELS = tuple(_kinds(FileModel))
_TYPES = [kind.annotation for model in _MODELS if (kind := model.model_fields.get("type")) is not None]
_TAGS = frozenset(("other", *(str(name) for kind in _TYPES for name in get_args(kind))))  # of alternatives
_ALL_KEYS = sorted({field.alias or key for model in _MODELS for key, field in model.model_fields.items()})
