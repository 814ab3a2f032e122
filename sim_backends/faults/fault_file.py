"""Fault files (``hilfit/faults/1``): which fault of a simulated machine begins when, and for how long.

::

    schema: hilfit/faults/1
    faults:
      - {at: 5, for: 2, fault: node_death, bus: can, node: 31}
      - {at: 10, for: 0.5, every: 30, fault: slow_peer, bus: modbus, seconds: 0.06}
      - {at: 20, for: 1, fault: bias_step, channel: joint1.head_pressure, size: 5}

Times are seconds of the wall's clock since acquisition sent its first SYNC: some faults stop machine time itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import yaml
from pydantic import ConfigDict, Field, ValidationError, model_validator

from daq import safe_yaml
from daq.errors import BadValueError, InputError
from daq.machine.buses import FileModel, Name
from daq.machine.machine_file import CanopenBus, CanSource, Machine, ModbusSource, ModbusTcpBus
from daq.machine.machine_file_errors import Problem, all_problems, did_you_mean, line_of, short
from daq.messages import Sentence, first_of

SCHEMA = "hilfit/faults/1"
Share = Annotated[float, Field(gt=0, le=1)]
Seconds = Annotated[float, Field(gt=0, le=2)]


class Fault(FileModel):
    """Times of every fault: when it begins, how long it lasts, and after how long it comes again."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, validate_by_name=True)

    at: Annotated[float, Field(ge=0, le=1e6)]  # s since the first SYNC
    seconds_long: Annotated[float, Field(gt=0, le=1e6, alias="for")]
    every: Annotated[float, Field(gt=0)] | None = None  # s from beginning to beginning; None: once

    @model_validator(mode="after")
    def _ends_before_it_comes_again(self) -> Fault:
        if self.every is not None and self.every <= self.seconds_long:
            code, lasts = "sim_backends.fault_every_too_short", self.seconds_long
            raise BadValueError(code, at=("every",), every=self.every, lasts=lasts)
        return self


class DeviceFault(Fault):
    """A fault of one device: a node of a CANopen bus, or a unit of a Modbus bus."""

    bus: Name
    node: Annotated[int, Field(ge=1, le=127)] | None = None
    unit: Annotated[int, Field(ge=0, le=255)] | None = None

    @model_validator(mode="after")
    def _one_device(self) -> DeviceFault:
        if (self.node is None) == (self.unit is None):
            raise BadValueError("sim_backends.fault_node_or_unit")
        return self


class Death(DeviceFault):
    """The device falls silent altogether, and comes back: a node with a boot-up message, its mapping forgotten."""

    fault: Literal["node_death"]


class Drop(DeviceFault):
    """So large a share of a node's TPDOs, or of a unit's answers, is lost."""

    fault: Literal["drop"]
    share: Share = 1.0


class Corrupt(DeviceFault):
    """So large a share of them is disturbed on its way: error frames, wrong check sums, wrong headers."""

    fault: Literal["corrupt"]
    share: Share = 1.0


class Delay(DeviceFault):
    """A node's TPDOs come ``syncs`` SYNCs after their own, a unit's answers ``seconds`` after they should."""

    fault: Literal["delay"]
    syncs: Annotated[int, Field(ge=1, le=3)] | None = None
    seconds: Seconds | None = None

    @model_validator(mode="after")
    def _in_the_device_s_measure(self) -> Delay:
        if (self.node is None) != (self.syncs is None) or (self.unit is None) != (self.seconds is None):
            raise BadValueError("sim_backends.fault_delay_measure")
        return self


class DuplicateId(Fault):
    """A second device with the same node-ID, which measures something else."""

    fault: Literal["duplicate_id"]
    bus: Name
    node: Annotated[int, Field(ge=1, le=127)]


class EmcyStorm(Fault):
    """So many EMCY messages at once; at the end one that says that the error is gone."""

    fault: Literal["emcy_storm"]
    bus: Name
    node: Annotated[int, Field(ge=1, le=127)]
    count: Annotated[int, Field(ge=1, le=100_000)] = 2000
    code: Annotated[int, Field(ge=0x0100, le=0xFFFF)] = 0x5000


class SignalFault(Fault):
    """A fault of one sensor: what it says is wrong, and its device does not know."""

    channel: str


class Freeze(SignalFault):
    """The value stands still."""

    fault: Literal["freeze"]


class NotANumber(SignalFault):
    """The value is NaN."""

    fault: Literal["nan"]


class NoiseBurst(SignalFault):
    """White noise of the standard deviation ``size``, in the channel's unit, comes on top."""

    fault: Literal["noise_burst"]
    size: Annotated[float, Field(gt=0)]


class BiasStep(SignalFault):
    """``size``, in the channel's unit, comes on top."""

    fault: Literal["bias_step"]
    size: float


class Saturate(SignalFault):
    """The value stays at the upper end of the channel's ``range``."""

    fault: Literal["saturate"]


class BusOff(Fault):
    """The CAN controller of the interface is bus-off, and is so again after each restart."""

    fault: Literal["bus_off"]
    bus: Name


class HalfOpen(Fault):
    """A gateway loses power while its TCP connections stay open; when it is back it knows none of them."""

    fault: Literal["half_open"]
    bus: Name


class SlowPeer(Fault):
    """A gateway hands everything on in pieces, over ``seconds``."""

    fault: Literal["slow_peer"]
    bus: Name
    seconds: Seconds


class SyncJitter(Fault):
    """SYNC reaches the nodes late by a random time of at most ``seconds``."""

    fault: Literal["sync_jitter"]
    bus: Name
    seconds: Annotated[float, Field(gt=0, le=0.2)]


class ClockJump(Fault):
    """The clock that stamps the frames of a CAN bus is set by ``seconds``, and back at the end."""

    fault: Literal["clock_jump"]
    bus: Name
    seconds: Annotated[float, Field(ge=-1e8, le=1e8)]


AnyFault = Annotated[
    Death
    | Drop
    | Corrupt
    | Delay
    | DuplicateId
    | EmcyStorm
    | Freeze
    | NotANumber
    | NoiseBurst
    | BiasStep
    | Saturate
    | BusOff
    | HalfOpen
    | SlowPeer
    | SyncJitter
    | ClockJump,
    Field(discriminator="fault"),
]
_MODELS: tuple[type[Fault], ...] = get_args(get_args(AnyFault)[0])
FAULTS = tuple(get_args(model.model_fields["fault"].annotation)[0] for model in _MODELS)


class FaultScript(FileModel):
    """A fault file."""

    schema_: Annotated[Literal["hilfit/faults/1"], Field(alias="schema")]
    faults: tuple[AnyFault, ...]


_ALL: tuple[type[FileModel], ...] = (*_MODELS, FaultScript)
_KEYS = sorted({field.alias or key for model in _ALL for key, field in model.model_fields.items()})


def load_faults(path: str | Path, machine: Machine) -> FaultScript:
    """Read a fault file and check it against the machine that is simulated.

    Raises
    ------
    InputError
        The first mistake in one line, and how many more there are; :func:`fault_problems` has all of them.
    """
    script, problems = read_faults(path, machine)
    if script is None:
        raise InputError(first_of(problems))
    return script


def read_faults(path: str | Path, machine: Machine) -> tuple[FaultScript | None, list[str]]:
    """Read the script of a fault file, or None and one line for every mistake in it."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        return None, [Sentence("sim_backends.no_fault_file", path=path)]
    except UnicodeDecodeError:
        return None, [Sentence("sim_backends.fault_file_no_text", path=path)]
    except OSError as error:
        return None, [Sentence("sim_backends.fault_file_not_readable", path=path, reason=error.strerror)]
    script, problems = fault_problems(text, machine, str(path))
    return script, [problem.under(str(path)) for problem in problems]


def fault_problems(text: str, machine: Machine, name: str = "fault file") -> tuple[FaultScript | None, list[Problem]]:
    """Parse the script of a text, or None and everything that is wrong with it."""
    try:
        tree, content = safe_yaml.read(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        what = " ".join(str(getattr(error, "problem", None) or "cannot be parsed").split())
        text = Sentence("sim_backends.fault_file_no_yaml", what=what)
        return None, [Problem(mark.line + 1 if mark is not None else None, "", text)]
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        return None, [Problem(None, "", Sentence("sim_backends.not_a_fault_file", schema=SCHEMA))]
    unknown = list(_unknown_faults(tree, content))
    try:
        script = FaultScript.model_validate(content)
    except ValidationError as error:
        others = all_problems(tree, error, _KEYS, frozenset(FAULTS))
        named = {problem.key.removesuffix(".fault") for problem in unknown}
        return None, [*unknown, *(problem for problem in others if problem.key not in named)]
    found = [
        Problem(line_of(tree, ["faults", number, key]), f"faults[{number}].{key}", what)
        for number, fault in enumerate(script.faults)
        for key, what in _misfits(fault, machine)
    ]
    return (None, found) if found else (script, [])


def _unknown_faults(tree: yaml.Node | None, content: dict[str, Any]) -> Iterator[Problem]:
    """Yield entries whose fault does not exist; their other keys cannot be judged before that is known."""
    listed = content.get("faults")
    for number, entry in enumerate(listed if isinstance(listed, list) else ()):
        name = entry.get("fault") if isinstance(entry, dict) else None
        if name not in FAULTS:
            where = f"faults[{number}].fault"
            hint = did_you_mean(str(name), FAULTS) or Sentence("daq.there_are", options=FAULTS)
            what = Sentence("daq.value_missing")
            if name is not None:
                what = Sentence("sim_backends.fault_none", name=short(repr(name)))
            yield Problem(line_of(tree, ["faults", number, "fault"]), where, what + hint)


def _misfits(fault: Fault, machine: Machine) -> Iterator[tuple[str, str]]:
    """Yield keys of a fault that this machine has nothing for, and what is wrong with each."""
    if isinstance(fault, SignalFault):
        yield from _channel_misfits(fault, machine)
        return
    buses = {bus.name: bus for bus in machine.buses}
    name: str = getattr(fault, "bus")  # noqa: B009 (every fault but a signal's has one)
    bus = buses.get(name)
    if bus is None:
        hint = _choose(name, buses)
        yield "bus", Sentence("sim_backends.fault_no_bus", machine=machine.name, bus=name, hint=hint)
        return
    can = isinstance(bus, CanopenBus)
    if isinstance(fault, HalfOpen | SlowPeer):
        if isinstance(fault, HalfOpen) and not can and not isinstance(bus, ModbusTcpBus):
            yield "bus", Sentence("sim_backends.fault_serial_line", bus=name)
        return
    unit, node = getattr(fault, "unit", None), getattr(fault, "node", None)
    if not can and not isinstance(fault, DeviceFault):
        yield "bus", Sentence("sim_backends.fault_needs_canopen", bus=name, type=bus.type)
        return
    if can == (unit is not None):
        key = "node" if can else "unit"
        yield "bus", Sentence("sim_backends.fault_other_device", bus=name, type=bus.type, key=key)
        return
    key, number = ("node", node) if can else ("unit", unit)
    if number is None:
        return
    there = sorted({_number(c.source) for c in machine.channels if c.source is not None and c.source.bus == name})
    if number not in there:
        yield key, Sentence("sim_backends.fault_no_device", bus=name, key=key, number=number, there=there)


def _channel_misfits(fault: SignalFault, machine: Machine) -> Iterator[tuple[str, str]]:
    channels = {channel.name: channel for channel in machine.channels}
    channel = channels.get(fault.channel)
    if channel is None:
        which = {"machine": machine.name, "channel": fault.channel}
        yield "channel", Sentence("sim_backends.fault_no_channel", **which, hint=_choose(fault.channel, channels))
    elif not isinstance(channel.source, CanSource | ModbusSource):
        yield "channel", Sentence("sim_backends.fault_channel_not_simulated", channel=fault.channel)
    elif isinstance(fault, NotANumber) and not channel.source.data_type.startswith("float"):
        data_type = channel.source.data_type
        yield "channel", Sentence("sim_backends.fault_channel_no_float", channel=fault.channel, data_type=data_type)
    elif isinstance(fault, Saturate) and channel.range is None:
        yield "channel", Sentence("sim_backends.fault_channel_no_range", channel=fault.channel)


def _choose(word: str, options: dict[str, Any]) -> str:
    return did_you_mean(word, list(options)) or Sentence("daq.there_are", options=list(options)[:8])


def _number(source: Any) -> int:
    return source.node if isinstance(source, CanSource) else getattr(source, "unit", 0)


def targets(fault: Fault, machine: Machine) -> frozenset[str]:
    """Return the channels that a fault may cost something."""
    if isinstance(fault, SignalFault):
        return frozenset((fault.channel,))
    bus: str = getattr(fault, "bus")  # noqa: B009
    number = getattr(fault, "node", None) if getattr(fault, "unit", None) is None else getattr(fault, "unit", None)
    return frozenset(
        c.name
        for c in machine.channels
        if c.source is not None and c.source.bus == bus and (number is None or _number(c.source) == number)
    )
