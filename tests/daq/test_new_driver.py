"""CONTRIBUTING names every file that a new driver touches: one is added to a copy, by those files alone, and used."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BUS = '''
class DatagramSource(Scaled):
    """A number of a datagram."""

    known_by = frozenset({"slot"})
    slot: Annotated[int, Field(ge=0)]


class DatagramBus(AnyBus):
    """Datagrams of 32-bit numbers."""

    source = DatagramSource
    type: Literal["datagrams"]
    port: PortNumber

    @property
    def place(self) -> str:
        """This computer's port."""
        return f"tcp:127.0.0.1:{self.port}"


'''
DRIVER = '''
"""Datagrams of 32-bit numbers, taken as they come."""

import socket
import struct
import threading

from daq.drivers.bus_driver import Port
from daq.drivers.listening import Inbox, Listener, Stream
from daq.errors import BusError


class DatagramPort(Port):
    def __init__(self, bus, context, inbox):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.1)
        try:
            self._socket.bind(("127.0.0.1", bus.port))
        except OSError as error:
            self._socket.close()
            raise BusError(f"bus '{bus.name}': {error}; correct port") from None
        self._open, self._now, self._inbox = True, context.monotonic_ns, inbox
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while self._open:
            try:
                self._inbox.receive(self._socket.recv(1000), self._now())
            except TimeoutError:
                pass

    def close(self):
        self._open = False
        self._thread.join()
        self._socket.close()


class DatagramDriver(Listener):
    def __init__(self, bus, channels, context):
        super().__init__(bus, [channel.name for channel in channels], context)
        self._slots = [channel.source.slot for channel in channels]
        self._inbox = Inbox(16)
        self.streams = [Stream("the datagram", "sender", range(len(channels)))]

    def connected(self):
        return DatagramPort(self.config, self.context, self._inbox)

    def decode(self, answers):
        for data, at_ns, _ in self._inbox.taken():
            quality = self.came(self.streams[0], at_ns, answers)
            for position, slot in enumerate(self._slots):
                answers.value(position, struct.unpack_from("<f", data, 4 * slot)[0], quality)
'''
USE = """
import socket, struct, sys, threading, tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import daq, daq.seams
from daq import MachineFileError, parse_machine
from daq.drivers import make_driver
from daq.drivers.conformance import check_driver
from daq.machine.machine_check import check_machine

assert Path(daq.__file__).is_relative_to(Path.cwd())
named = tomllib.loads(Path("pyproject.toml").read_text())["project"]["entry-points"]
daq.seams.entry_points = lambda group: [EntryPoint(name, value, group) for name, value in named[group].items()]

with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
text = sys.argv[1].replace("PORT", str(port))
Path("arm.yaml").write_text(text)
assert not check_machine("arm.yaml").errors
machine = parse_machine(text)
assert machine.buses[0].place == f"tcp:127.0.0.1:{port}"
for wrong, says in (("type: datagram,", "did you mean 'datagrams'"), ("slot: 1, table: input", "table"),
                    ("slot: 1, signal: x", "source.signal: unknown key")):
    right = "type: datagrams," if "type" in wrong else "slot: 1"
    try:
        parse_machine(text.replace(right, wrong))
    except MachineFileError as error:
        assert says in str(error) and "\\n" not in str(error), error
    else:
        raise AssertionError(wrong)

ended, quiet = threading.Event(), threading.Event()

def send():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while not ended.wait(0.01):
            if not quiet.is_set():
                sender.sendto(struct.pack("<ff", 0.25, 3000.0), ("127.0.0.1", port))

thread = threading.Thread(target=send)
thread.start()
try:
    check_driver(lambda context: make_driver(machine.buses[0], machine.channels, context),
                 {"j1.angle": 0.25, "j1.effort": 3000.0}, period_s=0.1, silence=quiet.set, restore=quiet.clear)
finally:
    ended.set()
    thread.join()
"""
MACHINE = """schema: hilfit/machine/1
name: arm
gravity: [0.0, -9.81, 0.0]
joints:
  - {name: j1, type: revolute, dh: {a: 1.0, alpha: 0.0, d: 0.0, theta: 0.0}, cylinder: null,
     limits: {position: [-1.0, 1.0], velocity: 1.0, acceleration: 2.0}}
buses:
  - {name: field, type: datagrams, port: PORT}
channels:
  - {name: j1.angle, quantity: joint_position, joint: j1, unit: rad, source: {bus: field, slot: 0}}
  - {name: j1.effort, quantity: joint_effort, joint: j1, unit: N m, source: {bus: field, slot: 1}}
"""


def told() -> set[str]:
    """Files that the table of CONTRIBUTING says a driver is written in and registered in."""
    (row,) = (line for line in (ROOT / "CONTRIBUTING.md").read_text().splitlines() if line.startswith("| a driver |"))
    _, _, write, register, _, _ = re.split(r"(?<!\\)\|", row)
    copied = re.search(r"\(to copy: .*?\)", write)
    assert copied is not None
    return set(re.findall(r"`([\w/]+\.(?:py|toml))`", write.replace(copied[0], "") + register))


@pytest.mark.slow
def test_a_driver_is_added_by_the_files_that_contributing_names(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "daq", tmp_path / "daq", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    classes, table = "\nclass OtherBus(", "BUSES: tuple[type[AnyBus], ...] = (\n"
    entries = '[project.entry-points."hilfit.drivers"]\n'
    changes = {
        "daq/drivers/my_bus.py": {"": DRIVER},
        "daq/machine/buses.py": {classes: BUS + classes, table: f"{table}    DatagramBus,\n"},
        "pyproject.toml": {entries: f'{entries}datagrams = "daq.drivers.my_bus:DatagramDriver"\n'},
    }
    assert told() == set(changes)
    for name, replaced in changes.items():
        path = tmp_path / name
        text = path.read_text() if path.exists() else ""
        for before, after in replaced.items():
            assert text.count(before) == 1, f"{name} has {before!r} {text.count(before)} times; correct it in this test"
            text = text.replace(before, after)
        path.write_text(text)
    command = [sys.executable, "-c", USE, MACHINE]
    done = subprocess.run(command, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
