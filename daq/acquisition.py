"""The acquisition process: a cycle led by SYNC, from the drivers to the ring buffer.

It is a process of its own because a busy thread in the same interpreter delays every tick by milliseconds; it asks for
SCHED_FIFO where the system allows it and goes on without. Use :class:`AcquisitionProcess`; :func:`run_cycles`
is the loop itself, with its clock and drivers as arguments.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from daq.assembly import Assembler
from daq.channels import ChannelTable, channel_table, channels_by_bus
from daq.clock import Clock, clock_for
from daq.drivers.base import Driver, DriverContext, DriverStatistics, make_driver
from daq.errors import AcquisitionError, HilfitError
from daq.frame import row_from_frame
from daq.machine_file import Machine, load_machine
from daq.quality import Quality
from daq.ring import RingReader, RingWriter, ring_buffer

RING_SECONDS = 60.0
INFO_SECONDS = 0.5
START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0
FIFO_PRIORITY = 20


@dataclass(frozen=True)
class AcquisitionStatistics:
    """How acquisition has been doing since it started.

    Attributes
    ----------
    state : ``starting``, ``running``, ``stopped`` or ``failed``
    cycles : frames published
    skipped : cycles that never happened because their time had passed (real clock)
    late : cycles that started more than a tenth of a period after their time
    slipped : the same in lockstep with a simulation, where they delay what follows instead of being lost
    worst_late_ms : largest lateness in ms
    quality : per channel, frames of each quality by name (qualities that never occurred are left out)
    buses : per bus the state of its devices, and counters
    fifo : whether the real-time scheduling class was granted
    warnings : one line each
    """

    state: str = "starting"
    cycles: int = 0
    skipped: int = 0
    late: int = 0
    slipped: int = 0
    worst_late_ms: float = 0.0
    quality: dict[str, dict[str, int]] = field(default_factory=dict)
    buses: list[dict[str, Any]] = field(default_factory=list)
    fifo: bool = False
    warnings: list[str] = field(default_factory=list)

    def missing(self) -> int:
        """Frames in which some value was not fresh, counted per channel and summed."""
        return sum(n for counts in self.quality.values() for name, n in counts.items() if name != "fresh")


class Cycles:
    """The loop's state: what :func:`run_cycles` counts and publishes."""

    def __init__(self, machine: Machine, table: ChannelTable, drivers: Sequence[Driver], clock: Clock) -> None:
        self.lockstep = machine.simulation is not None and machine.simulation.lockstep
        # Drivers that send SYNC come first: polled devices are asked after it.
        self.drivers = sorted(drivers, key=lambda driver: not driver.leads)
        self.assembler = Assembler(
            table, [driver.channels for driver in self.drivers], machine.rate_hz, lockstep=self.lockstep
        )
        self.clock = clock
        self.table = table
        self._period_ns = 1e9 / (machine.rate_hz * (machine.simulation.speed if machine.simulation else 1.0))
        self.cycles = self.skipped = self.late = 0
        self.worst_late_ns = 0

    def once(self, ring: RingWriter) -> None:
        """One cycle: wait for its tick, trigger, collect, publish."""
        tick = self.clock.wait()
        sync_ns, utc_ns = self.clock.monotonic_ns(), self.clock.utc_ns()
        for driver in self.drivers:
            driver.trigger(tick.cycle)
        samples = [driver.collect(tick.collect_until_ns) for driver in self.drivers]
        ring.write(row_from_frame(self.assembler.frame(tick, sync_ns, utc_ns, samples)))
        self.cycles += 1
        self.skipped += tick.skipped
        self.late += tick.late_ns > self._period_ns / 10
        self.worst_late_ns = max(self.worst_late_ns, tick.late_ns)

    def statistics(self, state: str, *, fifo: bool, warnings: Sequence[str]) -> AcquisitionStatistics:
        """State of everything, for whoever asks."""
        counts = self.assembler.counts
        quality = {
            name: {q.name.lower(): int(counts[q, i]) for q in Quality if counts[q, i]}
            for i, name in enumerate(self.table.names)
        }
        return AcquisitionStatistics(
            state=state,
            cycles=self.cycles,
            skipped=self.skipped,
            late=0 if self.lockstep else self.late,
            slipped=self.late if self.lockstep else 0,
            worst_late_ms=self.worst_late_ns / 1e6,
            quality=quality,
            buses=[_as_dict(driver.statistics()) for driver in self.drivers],
            fifo=fifo,
            warnings=list(warnings),
        )


def _as_dict(statistics: DriverStatistics) -> dict[str, Any]:
    return {
        "bus": statistics.bus,
        "devices": [{"name": d.name, "state": d.state, "detail": d.detail} for d in statistics.devices],
        "counts": dict(statistics.counts),
    }


def run_cycles(
    cycles: Cycles,
    ring: RingWriter,
    stop: Callable[[], bool],
    *,
    fifo: bool = False,
    warnings: Sequence[str] = (),
) -> None:
    """Run cycles until ``stop()``; statistics go into the ring twice a second."""
    clock = cycles.clock
    clock.start()
    ring.set_info(vars(cycles.statistics("running", fifo=fifo, warnings=warnings)))
    next_info = clock.monotonic_ns() + round(INFO_SECONDS * 1e9)
    while not stop():
        cycles.once(ring)
        if clock.monotonic_ns() >= next_info:
            next_info = clock.monotonic_ns() + round(INFO_SECONDS * 1e9)
            ring.set_info(vars(cycles.statistics("running", fifo=fifo, warnings=warnings)))
    ring.set_info(vars(cycles.statistics("stopped", fifo=fifo, warnings=warnings)))


def _child(machine: Machine, name: str, strict: bool, control: Connection) -> None:
    """Main of the acquisition process; says ``("running", "")`` or ``("failed", line)`` through ``control``."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops us, also when Ctrl-C reaches the whole group
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stopping.set())
    for library in ("can", "canopen", "pymodbus"):
        logging.getLogger(library).setLevel(logging.CRITICAL)  # what they report is in the devices' states
    try:
        with RingWriter(name) as ring, contextlib.closing(_Drivers(machine)) as drivers:
            try:
                fifo, refusal = _request_fifo()  # before the drivers' threads, which inherit it
                problems = drivers.start()
                if problems and strict:
                    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
                    raise AcquisitionError(problems[0] + more)
                warnings = [*problems, *([refusal] if refusal else [])]
                cycles = Cycles(machine, channel_table(machine), drivers.drivers, clock_for(machine))
                threading.Thread(target=_listen, args=(control, stopping), daemon=True).start()
                control.send(("running", ""))
                run_cycles(cycles, ring, stopping.is_set, fifo=fifo, warnings=warnings)
            finally:
                ring.finish()
    except HilfitError as error:
        _say(control, "failed", str(error))
    except Exception as error:  # the parent must not be left waiting for a process that died of a bug
        _say(control, "failed", f"acquisition of '{machine.name}' broke: {type(error).__name__}: {error}")
        raise


def _say(control: Connection, what: str, text: str) -> None:
    with contextlib.suppress(OSError):
        control.send((what, " ".join(text.split())))


def _listen(control: Connection, stopping: threading.Event) -> None:
    """Anything on the pipe, and its end (the parent died), mean stop."""
    with contextlib.suppress(EOFError, OSError):
        control.recv()
    stopping.set()


class _Drivers:
    """All drivers of a machine, started together and stopped together."""

    def __init__(self, machine: Machine) -> None:
        simulation = machine.simulation
        clock = clock_for(machine)
        context = DriverContext(
            period_s=1.0 / (machine.rate_hz * (simulation.speed if simulation else 1.0)),
            patient=simulation is not None and simulation.lockstep,
            monotonic_ns=clock.monotonic_ns,
        )
        grouped = channels_by_bus(machine, f"machine '{machine.name}'")
        self.drivers: list[Driver] = [
            make_driver(bus, grouped[bus.name], context) for bus in machine.buses if bus.name in grouped
        ]

    def start(self) -> list[str]:
        """Start every driver; one line per device that cannot be used."""
        problems: list[str] = []
        for driver in sorted(self.drivers, key=lambda driver: not driver.leads):
            problems += driver.start()
        return problems

    def close(self) -> None:
        """Stop every driver."""
        for driver in self.drivers:
            driver.stop()


def _request_fifo() -> tuple[bool, str]:
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except (PermissionError, OSError) as error:
        return False, (
            f"no real-time scheduling ({error.strerror}): cycles may be late on a busy machine; allow SCHED_FIFO "
            "(CAP_SYS_NICE, or rtprio in limits.conf)"
        )
    return True, ""


class AcquisitionProcess:
    """Acquisition of one machine in a process of its own; use it in a ``with`` block.

    Parameters
    ----------
    machine : a machine, or the path of its file
    ring_name : name of the ring buffer; None for a free one. A name that is in use is an error: a machine is
        acquired once.
    strict : every device has to be there at the start; else those that are not stay missing and are tried again
    ring_seconds : how much machine time the ring holds

    Raises
    ------
    MachineFileError
        At once, if the file is wrong or says nothing about buses.
    AcquisitionError
        From :meth:`wait_running` (and the ``with`` statement, which waits), with the line that the process left.
    """

    def __init__(
        self,
        machine: Machine | str | Path,
        ring_name: str | None = None,
        *,
        strict: bool = True,
        ring_seconds: float = RING_SECONDS,
    ) -> None:
        self.machine = machine if isinstance(machine, Machine) else load_machine(machine)
        channels_by_bus(self.machine, str(machine) if not isinstance(machine, Machine) else machine.name)
        self._requested_name = ring_name
        self._strict = strict
        self._slots = max(16, int(ring_seconds * self.machine.rate_hz))
        self._resources = contextlib.ExitStack()
        self._process: Any = None
        self._control: Connection | None = None
        self._reader: RingReader | None = None
        self._failure: str | None = None
        self._running = False
        self.ring_name = ""

    def start(self) -> None:
        """Make the ring buffer and start the process; returns before it runs."""
        dtype = channel_table(self.machine).dtype
        self.ring_name = self._resources.enter_context(ring_buffer(dtype, self._slots, self._requested_name))
        self._reader = self._resources.enter_context(RingReader(self.ring_name))
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._process = context.Process(
            target=_child,
            args=(self.machine, self.ring_name, self._strict, theirs),
            name=f"hilfit-acquisition-{self.machine.name}",
            daemon=True,
        )
        self._process.start()
        theirs.close()

    def wait_running(self, timeout: float = START_TIMEOUT_S) -> None:
        """Wait until cycles are running.

        Raises
        ------
        AcquisitionError
            If it failed to start, in one line; or did not within ``timeout`` s.
        """
        if self._control is None:
            raise AcquisitionError("acquisition was not started; call start()")
        if not self._running and not self._control.poll(timeout):
            raise AcquisitionError(
                f"acquisition of '{self.machine.name}' is not running after {timeout:g} s; check its buses"
            )
        self._hear()
        self.check()

    def _hear(self) -> None:
        """Take in what the process said; its silence after the end is a failure too."""
        if self._control is None:
            return
        try:
            while self._control.poll(0):
                what, text = self._control.recv()
                self._running = what == "running"
                if what == "failed":
                    self._failure = text
        except (EOFError, OSError):
            self._running = False
            if self._failure is None and self._process is not None:
                self._process.join(1.0)
                self._failure = (
                    f"acquisition of '{self.machine.name}' ended by itself "
                    f"(exit code {self._process.exitcode}); start it again"
                )

    def check(self) -> None:
        """Raise AcquisitionError if it has failed since."""
        self._hear()
        if self._failure is not None:
            raise AcquisitionError(self._failure)

    @property
    def alive(self) -> bool:
        """Whether cycles are running."""
        self._hear()
        return self._running and self._failure is None

    def statistics(self) -> AcquisitionStatistics:
        """What the process published last, at most half a second old."""
        info = self._reader.info() if self._reader is not None else {}
        statistics = AcquisitionStatistics(**info)
        if self._failure is not None:
            return AcquisitionStatistics(**{**vars(statistics), "state": "failed", "warnings": [self._failure]})
        return statistics

    def stop(self) -> AcquisitionStatistics:
        """Stop the process, release the ring buffer, and return the last statistics; may be called again."""
        process, self._process = self._process, None
        if process is not None:
            if self._control is not None:
                with contextlib.suppress(OSError):
                    self._control.send("stop")
            process.join(STOP_TIMEOUT_S)
            if process.is_alive():
                process.kill()
                process.join()
            self._final = self.statistics()
            process.close()
            if self._control is not None:
                self._control.close()
                self._control = None
            self._running = False
            self._reader = None
            self._resources.close()
        return self._final

    _final = AcquisitionStatistics(state="stopped")

    def __enter__(self) -> Self:
        try:
            self.start()
            self.wait_running()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()


__all__ = ["AcquisitionProcess", "AcquisitionStatistics", "Cycles", "run_cycles"]
