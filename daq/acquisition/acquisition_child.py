"""The acquisition process itself; :class:`daq.acquisition.acquisition.AcquisitionProcess` starts it as ``python -m``.

It is not started by multiprocessing, which would import the parent's main script into it once more.
"""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from pathlib import Path

import daq.without_mdf4  # noqa: F401
from daq.acquisition.cycles import Cycles, run_cycles
from daq.acquisition.ring import RingWriter
from daq.acquisition.trace import TraceAccess
from daq.confinement import confine
from daq.drivers.base import Driver, DriverContext, Problem, make_driver
from daq.drivers.canopen.driver import CanopenDriver
from daq.drivers.canopen.listening import ListeningDriver
from daq.drivers.found_setups import FoundSetups
from daq.errors import AcquisitionError, HilfitError
from daq.frames.channels import channel_table, channels_by_bus
from daq.frames.clock import Clock, NextSync, clock_for
from daq.frames.events import EventLog
from daq.machine.machine_file import Machine
from daq.messages import Sentence, first_of, one_line

FIFO_PRIORITY = 20
#: What is there has to be acquired within two seconds, whatever else is missing; libraries take some of them to load.
START_S = 1.0


def main(control: Connection) -> None:
    """Acquire what the parent orders: a machine, the name of its ring, the channels that have to be there, where to
    keep what nodes were like, and the raw trace to write.

    Sends ``("running", "")`` or ``("failed", line)`` through ``control``; stops when anything comes back.
    """
    machine, name, required, data_directory, trace = control.recv()
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stopping.set())
    for library in ("can", "canopen", "pymodbus"):
        logging.getLogger(library).setLevel(logging.CRITICAL)  # what they report is in the devices' states
    confine(["/dev", *_kept(machine, data_directory), *([trace.parent] if trace is not None else [])])
    try:
        with (
            RingWriter(name) as ring,
            contextlib.closing(_Drivers(machine, required, data_directory, trace)) as drivers,
        ):
            try:
                fifo, refusal = request_fifo()  # before the drivers' threads, which inherit it
                problems = drivers.start()
                fatal = [_line(problem) for problem in problems if drivers.is_fatal(problem)]
                if fatal:
                    raise AcquisitionError(first_of(fatal))
                warnings = [*map(_line, problems), *([refusal] if refusal else [])]
                cycles = Cycles(
                    machine, channel_table(machine), drivers.drivers, drivers.clock(), events=drivers.events
                )
                gc.collect()
                gc.freeze()  # what is loaded stays: looking through it all takes longer than a cycle
                threading.Thread(target=_listen, args=(control, stopping), daemon=True).start()
                _report(control, "running")
                run_cycles(cycles, ring, stopping.is_set, fifo=fifo, warnings=warnings)
            finally:
                ring.finish()
    except HilfitError as error:
        _report(control, "failed", str(error))
    except Exception as error:  # the parent must not be left waiting for a process that died of a bug
        _report(
            control,
            "failed",
            Sentence("daq.acquisition_broke", machine=machine.name, name=type(error).__name__, error=error),
        )
        raise


def _kept(machine: Machine, data_directory: Path | None) -> Iterator[Path]:
    """Make a folder for what drivers write of their findings, apart from the store of a service."""
    if data_directory is not None:
        folder = FoundSetups(data_directory, machine.name).folder
        folder.mkdir(parents=True, exist_ok=True)
        yield folder


def _report(control: Connection, what: str, text: str = "") -> None:
    """Notify the parent; one that died meanwhile is :func:`_listen`'s to notice."""
    with contextlib.suppress(OSError):
        control.send((what, one_line(text)))


def _listen(control: Connection, stopping: threading.Event) -> None:
    """Stop at anything on the pipe, and at its end (the parent died)."""
    with contextlib.suppress(EOFError, OSError):
        control.recv()
    stopping.set()


class _Drivers:
    """All drivers of a machine, started side by side and stopped together.

    Parameters
    ----------
    required : channels without which there is no point in starting; None: all of them
    data_directory : where it is kept what nodes were like before they were changed; None: it is not
    trace : raw trace of the CAN buses to write (:mod:`daq.acquisition.trace`)
    """

    def __init__(
        self,
        machine: Machine,
        required: frozenset[str] | None = None,
        data_directory: Path | None = None,
        trace: Path | None = None,
    ) -> None:
        simulation = machine.simulation
        clock = clock_for(machine)
        self.events = EventLog(clock.utc_ns, clock.monotonic_ns)
        self._required = required
        self._machine = machine
        self._period_s = 1.0 / (machine.rate_hz * (simulation.speed if simulation else 1.0))
        self._trace = None if trace is None else TraceAccess(trace, self.events)
        context = DriverContext(
            period_s=self._period_s,
            patience_s=simulation.patience_s if simulation is not None and simulation.lockstep else 0.0,
            monotonic_ns=clock.monotonic_ns,
            start_s=None if required is None or required else START_S,
            events=self.events,
            rate_hz=machine.rate_hz,
            found=None if data_directory is None else FoundSetups(data_directory, machine.name),
            can=self._trace,
        )
        grouped = channels_by_bus(machine, f"machine '{machine.name}'")
        self.drivers: list[Driver] = [
            make_driver(bus, grouped[bus.name], context) for bus in machine.buses if bus.name in grouped
        ]

    def start(self) -> list[str]:
        """Start every driver; one line per device that cannot be used."""
        with ThreadPoolExecutor(max(1, len(self.drivers)), "start") as pool:
            started = list(pool.map(_start, self.drivers))
        return [problem for problems in started for problem in problems]

    def clock(self) -> Clock:
        """Return what paces the cycle: the machine's own clock, or another master's SYNC where that leads."""
        return clock_for(self._machine, self._sync)

    def _sync(self) -> NextSync | None:
        """Return the source of the leading SYNC, if any: a bus has it, or a master came to one that we led."""
        for driver in self.drivers:
            if isinstance(driver, ListeningDriver | CanopenDriver) and driver.external_sync:
                return driver.next_sync
        return None

    def is_fatal(self, problem: str) -> bool:
        """Return whether it loses a required channel; a driver that names none loses all of its own."""
        if self._required is None:
            return True
        channels = getattr(problem, "channels", None)
        return bool(self._required) if channels is None else not self._required.isdisjoint(channels)

    def close(self) -> None:
        """Stop every driver."""
        for driver in self.drivers:
            driver.stop()
        if self._trace is not None:
            self._trace.close()


def _line(problem: str) -> str:
    """Return the sentence of a problem; a driver may give no more than a text."""
    return problem.line if isinstance(problem, Problem) else problem


def _start(driver: Driver) -> tuple[str, ...]:
    try:
        return driver.start()
    except AcquisitionError as error:  # of a driver that does not try again by itself
        return (Problem(str(error), driver.channels),)


def request_fifo() -> tuple[bool, str]:
    """Request the real-time class; return whether it was granted, and if not a line with the remedy."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except (PermissionError, OSError) as error:
        return False, (Sentence("daq.no_realtime_scheduling", reason=error.strerror))
    return True, ""


if __name__ == "__main__":
    main(Connection(int(sys.argv[1])))
