"""CONTRIBUTING names every file that a new driver touches: one is added to a copy, by those files alone, and used."""

from __future__ import annotations

import os
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
import sys
from pathlib import Path

import daq
from daq import MachineFileError, parse_machine
from daq.machine.machine_check import check_machine

assert Path(daq.__file__).is_relative_to(Path.cwd())
text = sys.argv[1].replace("PORT", "4711")
Path("arm.yaml").write_text(text)
assert not check_machine("arm.yaml").errors
assert parse_machine(text).buses[0].place == "tcp:127.0.0.1:4711"
for wrong, says in (("type: datagram,", "did you mean 'datagrams'"), ("slot: 1, table: input", "table"),
                    ("slot: 1, signal: x", "source.signal: unknown key")):
    right = "type: datagrams," if "type" in wrong else "slot: 1"
    try:
        parse_machine(text.replace(right, wrong))
    except MachineFileError as error:
        assert says in str(error) and "\\n" not in str(error), error
    else:
        raise AssertionError(wrong)
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

SENDER = f"""class Datagrams:
    def __init__(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.ended, self.silent = threading.Event(), threading.Event()
        self.text = {MACHINE!r}.replace("PORT", str(self.port))
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not self.ended.wait(0.01):
                if not self.silent.is_set():
                    sender.sendto(struct.pack("<ff", 0.25, 3000.0), ("127.0.0.1", self.port))

    def close(self):
        self.ended.set()
        self.thread.join()


"""
BENCH = """        if name == "datagrams":
            sent = Datagrams()
            close.append(sent.close)
            return sent.text, {"j1.angle": 0.25, "j1.effort": 3000.0}, sent.silent.set, sent.silent.clear
"""


def told() -> set[str]:
    """Files that the table of CONTRIBUTING says a driver is written in, registered in and checked in."""
    (row,) = (line for line in (ROOT / "CONTRIBUTING.md").read_text().splitlines() if line.startswith("| a driver |"))
    copied, this = re.search(r"\(to copy: .*?\)", row), "tests/daq/test_new_driver.py"
    assert copied is not None and this in row
    return set(re.findall(r"`([\w/]+\.(?:py|toml))`", row.replace(copied[0], ""))) - {this}


@pytest.mark.slow
def test_a_driver_is_added_by_the_three_files_that_contributing_names(tmp_path: Path) -> None:
    for folder in ("daq", "tests/daq"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    for file in ("pyproject.toml", "tests/conftest.py"):
        shutil.copy(ROOT / file, tmp_path / file)
    classes, table = "\nclass OtherBus(", "BUSES: tuple[BusKind, ...] = (\n"
    line = '    BusKind(DatagramBus, "daq.drivers.my_bus:DatagramDriver", {"port": 4711}, {"slot": 0}),\n'
    benches, others = "@pytest.fixture\ndef benches(", "        server: FakeModbus | FakeSerialModbus\n"
    changes = {
        "daq/drivers/my_bus.py": {"": DRIVER},
        "daq/machine/buses.py": {classes: BUS + classes, table: table + line},
        "tests/daq/test_driver_conformance.py": {
            "import struct\n": "import socket\nimport struct\n", benches: SENDER + benches, others: BENCH + others,
        },
    }  # fmt: skip
    assert told() == set(changes) and len(changes) <= 3
    for name, replaced in changes.items():
        path = tmp_path / name
        text = path.read_text() if path.exists() else ""
        for before, after in replaced.items():
            assert text.count(before) == 1, f"{name} has {before!r} {text.count(before)} times; correct it in this test"
            text = text.replace(before, after)
        path.write_text(text)
    tests = [f"tests/daq/{name}.py" for name in ("test_driver_conformance", "test_bus_places")]
    chosen = "datagrams or that_is_one or every_text"
    for command in (["-c", USE, MACHINE], ["-m", "pytest", "-p", "no:cacheprovider", "-k", chosen, *tests]):
        environment = {"PYTHONPATH": str(tmp_path), "PATH": os.environ["PATH"]}
        done = subprocess.run([sys.executable, *command], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout, done.stdout  # the driver on its bench, its example, and other texts in it
