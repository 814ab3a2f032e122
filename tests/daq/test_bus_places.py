"""A machine file is data: where it may lead is a closed grammar, and an administrator's list."""

from __future__ import annotations

import json
import os
import pkgutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import can
import pytest
import serial.urlhandler
from can.interfaces import VALID_INTERFACES
from fuzz_machine_files import honest_files, trespasses
from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from daq import parse_machine
from daq.drivers.can.port import open_bus
from daq.drivers.modbus.client import ModbusConnection
from daq.errors import BusError, MachineFileError
from daq.machine.bus_places import CAN_INTERFACES, check_entry, is_listed
from daq.machine.buses import (
    BUSES,
    AnyBus,
    Bus,
    CanNode,
    CanopenBus,
    CanSignalsBus,
    DeviceFile,
    FileModel,
    ModbusRtuBus,
    ModbusTcpBus,
    Scaled,
)
from daq.machine.device_files import names_files, refuse_files_elsewhere
from daq.machine.machine_file import Machine

BUS: TypeAdapter[Any] = TypeAdapter(Bus)
#: Every scheme that pyserial knows, as it is installed, and every interface of python-can, which may stand for one.
SCHEMES = sorted(
    {module.name.removeprefix("protocol_") for module in pkgutil.iter_modules(serial.urlhandler.__path__)}
    | set(VALID_INTERFACES) | {"http", "file", "ws", "unix"}
)  # fmt: skip
GOOD: dict[type[BaseModel], dict[str, Any]] = {
    kind.bus: {"name": "b", "type": kind.tag, **kind.example} for kind in BUSES
}


def test_every_kind_of_bus_has_an_example_that_is_one() -> None:
    machines = [parse_machine(json.dumps(file)) for file in honest_files()]
    assert {type(machine.buses[0]) for machine in machines} == set(GOOD)
    for machine in machines:  # a source by its keys alone
        assert type(machine.channels[0].source) is type(machine.buses[0]).source


def _holds_text(annotation: Any) -> bool:
    if annotation is str:
        return True
    if get_origin(annotation) in (Union, UnionType, dict, tuple) or get_args(annotation):
        return any(_holds_text(part) for part in get_args(annotation)) or any(
            isinstance(part, str) for part in get_args(annotation)
        )
    return False


def test_every_text_that_reaches_a_driver_refuses_every_scheme() -> None:
    tried, taken = 0, set()
    for model, good in GOOD.items():
        BUS.validate_python(good)
        fields = [name for name, own in model.model_fields.items() if _holds_text(own.annotation)]
        files = {name for name, own in model.model_fields.items() if names_files(own)}  # looked at before they are read
        for field in [name for name in fields if name not in {"name", "type", *files}]:
            for scheme in SCHEMES:
                for rest in ("/dev/ptmx?file=/tmp/x", "127.0.0.1:1"):
                    url = f"{scheme}://{rest}"
                    bad = {option: {**good.get("options", {}), option: url} for option in ("host", "channel", "url")}
                    for value in bad.values() if field == "options" else [url]:
                        tried += 1
                        with suppress(ValidationError):
                            BUS.validate_python({**good, field: value})
                            taken.add(f"{model.__name__}.{field}")
    assert taken == set(), "give each a type of daq.machine.bus_places, a pattern, or DeviceFile"
    assert tried > 300
    assert {"eds", "firmware"} == {
        name for name, own in CanNode.model_fields.items() if _holds_text(own.annotation)
    } - {"settings"}  # a file that is looked at first, and a text that is compared


@pytest.mark.parametrize("interface", sorted(set(VALID_INTERFACES) - set(CAN_INTERFACES)))
def test_other_interfaces_of_python_can_are_refused(interface: str) -> None:
    with pytest.raises(ValidationError):
        BUS.validate_python({"name": "b", "type": "canopen", "interface": interface, "channel": "can0"})


@pytest.mark.parametrize(
    "port",
    ["/dev/tty/../sda", "/dev/ptmx", "/dev/serial/by-id/../../sda", "COM1\n", "/tmp/x", "ttyUSB0", "/dev/ttyUSB0?x=1"],
)
def test_a_port_is_a_port(port: str) -> None:
    with pytest.raises(ValidationError, match="is no serial port"):
        BUS.validate_python({"name": "b", "type": "modbus_rtu", "port": port})


def test_a_bus_put_together_in_a_program_meets_the_same_grammar(tmp_path: Path) -> None:
    target = tmp_path / "store"
    target.write_bytes(b"precious")
    url = f"spy:///dev/ptmx?file={target}"
    slcan = CanopenBus(name="b", type="canopen", interface="slcan", channel="/dev/ttyACM0")
    with pytest.raises(BusError, match="no serial port"):
        open_bus(slcan.model_copy(update={"channel": url}))
    with pytest.raises(ValueError, match="no serial port"):
        ModbusConnection(ModbusRtuBus(**GOOD[ModbusRtuBus]).model_copy(update={"port": url}), 0.1)
    assert target.read_bytes() == b"precious"


def test_what_the_users_home_configures_is_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    with can.Bus(interface="virtual", channel="other", ignore_config=True):
        bus = open_bus(CanopenBus(name="b", type="canopen", interface="virtual", channel="x"))
        assert bus.receive_own_messages is False
        bus.shutdown()


@pytest.mark.parametrize(
    ("entry", "place", "about"),
    [
        ("can:socketcan:can*", "can:socketcan:can0", True),
        ("can:socketcan:can*", "can:pcan:can0", False),
        ("serial:/dev/ttyUSB*", "serial:/dev/ttyUSB1", True),
        ("serial:/dev/ttyUSB*", "serial:/dev/ttyS0", False),
        ("tcp:192.0.2.0/24:502", "tcp:192.0.2.77:502", True),
        ("tcp:192.0.2.0/24:502", "tcp:192.0.2.77:503", False),
        ("tcp:192.0.2.0/24:*", "tcp:192.0.3.1:502", False),
        ("tcp:192.0.2.0/24:502", "tcp:192.0.2.evil.example:502", False),
        ("tcp:Gateway:502", "tcp:gateway:502", True),
        ("tcp:*:502", "tcp:gateway:502", False),
        ("tcp:::/0:502", "tcp:fd00::1:502", True),
        ("driver:ethercat", "driver:ethercat", True),
    ],
)
def test_the_list(entry: str, place: str, about: bool) -> None:
    assert is_listed(place, [check_entry(entry)]) is about
    assert not is_listed(place, [])


@pytest.mark.parametrize("entry", ["", "can0", "tcp:host", "tcp:host:port", "usb:1", "tcp::502"])
def test_what_is_no_entry_is_refused(entry: str) -> None:
    with pytest.raises(ValueError, match="is no place"):
        check_entry(entry)


def test_places_of_buses() -> None:
    buses = (CanopenBus, CanSignalsBus, ModbusTcpBus, ModbusRtuBus)
    places = [BUS.validate_python(GOOD[bus]).place for bus in buses]
    assert places == ["tcp:192.0.2.10:29536", "serial:/dev/ttyACM0", "tcp:192.0.2.10:502", "serial:/dev/ttyUSB0"]
    assert BUS.validate_python({"name": "b", "type": "ethercat"}).place == "driver:ethercat"


class _Filed(FileModel):
    more: dict[str, DeviceFile | None] = Field(default_factory=dict)


class _FiledNode(_Filed):
    node: int = 7


class _FiledSource(Scaled, _Filed):
    """Where a channel comes from on a :class:`_FiledBus`."""


class _FiledBus(AnyBus, _Filed):
    """A kind of bus that nobody has thought of yet."""

    source = _FiledSource
    type: Literal["filed"] = "filed"
    file: DeviceFile | None = None
    units: tuple[_FiledNode, ...] = ()


@pytest.mark.parametrize(
    ("bus", "source", "by"),
    [
        ({"file": "/etc/passwd"}, {}, "bus 'b'"),
        ({"more": {"x": None, "y": "../other.txt"}}, {}, "bus 'b'"),
        ({"units": [{}, {"node": 8, "more": {"x": "/etc/passwd"}}]}, {}, "bus 'b' node 8"),
        ({}, {"more": {"x": "/etc/passwd"}}, "channel 'j1.angle'"),
    ],
)
def test_a_file_of_any_kind_of_bus_is_one_beside_the_machine_file(
    bus: dict[str, Any], source: dict[str, Any], by: str
) -> None:
    def machine(bus: dict[str, Any], source: dict[str, Any]) -> Machine:
        plain = parse_machine(json.dumps(honest_files()[0]))
        channel = plain.channels[0].model_copy(update={"source": _FiledSource(bus="b", **source)})
        return plain.model_copy(update={"buses": (_FiledBus(name="b", **bus),), "channels": (channel,)})

    refuse_files_elsewhere(machine({"file": "own.txt", "units": [{"more": {"x": "own.txt"}}]}, {}), "arm.yaml")
    with pytest.raises(MachineFileError, match=f"^arm.yaml: {by}: names a file outside"):
        refuse_files_elsewhere(machine(bus, source), "arm.yaml")


def fuzzed(program: str, files: int) -> dict[str, Any]:
    """What a program says of so many files; it is a process of its own, as a trace cannot be taken off again."""
    command = [sys.executable, str(Path(__file__).with_name(program)), str(files)]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    said: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert said["trespasses"] == []
    return said


@pytest.mark.slow
def test_opened_drivers_go_nowhere_else() -> None:
    """Buses with every text replaced, against drivers that are opened, with every open and connect traced."""
    told = fuzzed("fuzz_places.py", 1500)
    assert told["taken"] > 50 and told["reached"] > 20


@pytest.mark.slow
def test_an_acquisition_of_any_machine_file_goes_nowhere_else() -> None:
    """Whole machine files, changed at places of the whole schema, on the way of an upload and of its acquisition."""
    told = fuzzed("fuzz_machine_files.py", 1000)
    assert told["taken"] > 50 and told["reached"] > 20
    assert told["places"] > 0.9 * told["of"], "the files do not come to the whole schema"
    assert told["threads_left"] == 0, "a driver that was stopped goes on"


@pytest.mark.parametrize(
    ("seen", "beyond"),
    [
        (("open", "/dev/ttyUSB0"), False),
        (("open", "/dev/ttyUSB1"), True),
        (("open", "/tmp/store"), True),
        (("open", "/data/found/bench/b-5.json"), False),
        (("os.remove", "/data/../etc/passwd"), True),
        (("connect", "127.0.0.1"), True),
        (("connect", "/data/socket"), True),
    ],
)
def test_the_trace_tells_what_is_beyond(seen: tuple[str, str], beyond: bool) -> None:
    serial = next(own for own in honest_files() if own["buses"][0]["type"] == "modbus_rtu")
    machine = parse_machine(json.dumps(serial))
    assert bool(trespasses(machine, (Path("/data"),), [seen])) is beyond
