"""The CANopen driver over slcan: an adapter at the other end of a pseudo-terminal, that speaks Lawicel's commands."""

from __future__ import annotations

import contextlib
import os
import re
import threading
import time
import tty
from collections.abc import Iterator

import can as python_can
import numpy as np
import pytest
from bench_machines import can
from canopen_test_bench import Bench, fresh

from daq import Quality, parse_machine
from daq.drivers import Samples, make_driver

pytestmark = pytest.mark.slow


class Adapter:
    """A Lawicel adapter (CANUSB manual, version 1.0) between a terminal and a virtual bus.

    ``S6`` sets the bit rate, ``O`` and ``L`` open the channel (``L`` without acknowledging), ``C`` closes it,
    ``tiiildd..`` sends a frame; each is answered by carriage return, or by bell where it is refused. Frames come as
    they are sent.
    """

    def __init__(self, channel: str) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self.commands: list[str] = []
        self.opened = ""
        self.noise = b""  # put before each frame
        self._bus = python_can.Bus(interface="virtual", channel=channel)
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._hear, self._say)]
        for thread in self._threads:
            thread.start()

    def _hear(self) -> None:
        waiting = b""
        with contextlib.suppress(OSError, python_can.CanError):  # it was unplugged
            while data := os.read(self._master, 4096):
                *lines, waiting = (waiting + data).split(b"\r")
                for line in lines:
                    self._command(line.decode("ascii"))

    def _command(self, line: str) -> None:
        self.commands.append(line)
        sent = re.fullmatch(r"t([0-9A-F]{3})([0-8])((?:[0-9A-F]{2})*)", line, re.IGNORECASE)
        if sent is not None and self.opened == "O" and len(sent[3]) == 2 * int(sent[2]):
            data = bytes.fromhex(sent[3])
            self._bus.send(python_can.Message(arbitration_id=int(sent[1], 16), data=data, is_extended_id=False))
            os.write(self._master, b"z\r")
        elif line in ("O", "L", "C"):
            self.opened = "" if line == "C" else line
            os.write(self._master, b"\r")
        else:
            os.write(self._master, b"\r" if re.fullmatch(r"S[0-8]", line) and not self.opened else b"\a")

    def _say(self) -> None:
        while not self._ended.is_set():
            message = self._bus.recv(0.02)
            if message is not None and self.opened:
                text = f"t{message.arbitration_id:03X}{message.dlc}{bytes(message.data).hex().upper()}\r"
                with contextlib.suppress(OSError):
                    os.write(self._master, self.noise + text.encode())

    def unplug(self) -> None:
        """Its terminal is gone."""
        self._ended.set()
        self._threads[1].join(5)
        for end in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(end)
        self._bus.shutdown()


class SlcanBench(Bench):
    """The bench behind an adapter."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.adapter = Adapter(self.channel)
        self.text = can(self.adapter.port).replace(
            "interface: virtual\n", "interface: slcan\n  bitrate: 500000\n  options: {sleep_after_open: 0.0}\n"
        )
        self.driver = self.make(self.text)

    def close(self) -> None:
        super().close()
        self.adapter.unplug()


@pytest.fixture
def bench() -> Iterator[SlcanBench]:
    made = SlcanBench()
    yield made
    made.close()


def down(samples: Samples) -> bool:
    return bool(np.all(samples.quality == Quality.BUS_ERROR))


def test_nodes_behind_an_adapter_are_commissioned_and_read(bench: SlcanBench) -> None:
    assert bench.driver.start() == ()
    assert bench.until(fresh).raw.tolist() == [123456.0, 50.0, 20.5]
    assert "S6" in bench.adapter.commands and bench.adapter.opened == "O"
    bench.driver.stop()
    until = time.monotonic() + 5
    while bench.adapter.opened and time.monotonic() < until:  # the adapter reads in its own time
        time.sleep(0.01)
    assert bench.adapter.commands[-1] == "C"


def test_what_is_no_frame_is_no_value(bench: SlcanBench) -> None:
    """An adapter that resets says its version, bells, and halves of lines."""
    bench.driver.start()
    bench.until(fresh)
    bench.adapter.noise = b"V1013\rN1234\r\a\r"
    for _ in range(20):
        samples = bench.once()
        taken = samples.quality == Quality.FRESH
        assert np.all(samples.raw[taken] == np.array([123456.0, 50.0, 20.5])[taken])
    bench.adapter.noise = b""
    bench.until(fresh)


def test_an_adapter_that_is_unplugged_is_a_bus_that_is_down(bench: SlcanBench) -> None:
    bench.driver.start()
    bench.until(fresh)
    bench.adapter.unplug()
    bench.until(down)
    for _ in range(10):
        assert down(bench.once())
    (line,) = {device.detail for device in bench.driver.statistics().devices}
    assert line.startswith("bus 'can0': ") and "\n" not in line


def test_who_only_listens_opens_the_adapter_so_that_it_does_not_acknowledge(bench: SlcanBench) -> None:
    listening = bench.text.replace("listen_s: 0", "listen_only: true")
    listening = listening.replace("object: 0x6004,", "object: 0x6004, cob_id: 0x185,")
    listening = listening.replace("subindex: 1,", "subindex: 1, cob_id: 0x186,")
    listening = listening.replace("subindex: 2,", "subindex: 2, cob_id: 0x186, byte: 4,")
    bench.driver.stop()
    bench.adapter.commands.clear()
    machine = parse_machine(listening)
    driver = make_driver(machine.buses[0], machine.channels, bench.driver.context)
    driver.start()
    assert bench.adapter.opened == "L"
    driver.stop()
    assert not [command for command in bench.adapter.commands if command.startswith("t")]
