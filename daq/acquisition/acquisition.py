"""Acquisition as a process of its own, from the outside.

It is one because a busy thread in the same interpreter delays every tick by milliseconds. The loop that runs in it
is :mod:`daq.acquisition.cycles`.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import subprocess
import sys
from collections.abc import Iterable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

from daq.acquisition.cycles import AcquisitionStatistics
from daq.acquisition.ring import RingReader, ring_buffer
from daq.errors import AcquisitionError, InputError
from daq.frames.channels import channel_table, channels_by_bus
from daq.machine.machine_file import Machine, load_machine
from daq.machine.machine_file_errors import did_you_mean
from daq.messages import Sentence

__all__ = ["AcquisitionProcess", "AcquisitionStatistics"]

RING_SECONDS = 60.0
START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 10.0


class AcquisitionProcess:
    """Acquisition of one machine in a process of its own; use it in a ``with`` block.

    Parameters
    ----------
    machine : a machine, or the path of its file
    ring_name : name of the ring buffer; None for a free one. A name that is in use is an error: a machine is
        acquired once.
    strict : every device has to be there at the start; else those that are not stay missing and are tried again
    required : with ``strict=False``, channels whose devices have to be there all the same
    ring_seconds : how much machine time the ring holds
    data_directory : where it is kept what CANopen nodes were like before commissioning changed them, so that
        ``hilfit bus restore`` can put it back; None: it is not kept
    trace : raw trace of the CAN buses to write, a file per bus (:mod:`daq.acquisition.trace`)

    Raises
    ------
    MachineFileError
        At once, if the file is wrong or says nothing about buses.
    InputError
        At once, if the machine has no such channel as ``required`` names.
    AcquisitionError
        From :meth:`wait_running` (and the ``with`` statement, which waits), with the line that the process left.
    """

    def __init__(
        self,
        machine: Machine | str | Path,
        ring_name: str | None = None,
        *,
        strict: bool = True,
        required: Iterable[str] = (),
        ring_seconds: float = RING_SECONDS,
        data_directory: Path | None = None,
        trace: Path | None = None,
    ) -> None:
        self.machine = machine if isinstance(machine, Machine) else load_machine(machine)
        channels_by_bus(self.machine, str(machine) if not isinstance(machine, Machine) else machine.name)
        self._requested_name = ring_name
        self._required = None if strict else self._known(required)
        self._data_directory = None if data_directory is None else data_directory.absolute()
        self._trace = None if trace is None else trace.absolute()
        self._slots = max(16, int(ring_seconds * self.machine.rate_hz))
        self._resources = contextlib.ExitStack()
        self._process: subprocess.Popen[bytes] | None = None
        self._control: Connection | None = None
        self._reader: RingReader | None = None
        self._failure: str | None = None
        self._running = False
        self.ring_name = ""

    def _known(self, names: Iterable[str]) -> frozenset[str]:
        known = [channel.name for channel in self.machine.channels]
        for name in names:
            if name not in known:
                hint = did_you_mean(name, known)
                raise InputError("daq.machine_no_channel", machine=self.machine.name, name=name, hint=hint)
        return frozenset(names)

    def start(self) -> None:
        """Make the ring buffer and start the process; returns before it runs."""
        dtype = channel_table(self.machine).dtype
        self.ring_name = self._resources.enter_context(ring_buffer(dtype, self._slots, self._requested_name))
        self._reader = self._resources.enter_context(RingReader(self.ring_name))
        self._control, theirs = multiprocessing.Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "daq.acquisition.acquisition_child", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                process_group=0,  # Ctrl-C in a terminal is for the parent, which then stops us in order
            )
        with contextlib.suppress(OSError):  # it died at once: wait_running says so
            self._control.send((self.machine, self.ring_name, self._required, self._data_directory, self._trace))

    def wait_running(self) -> None:
        """Wait until cycles are running.

        Raises
        ------
        AcquisitionError
            If it failed to start, in one line; or did not within :data:`START_TIMEOUT_S`.
        """
        if self._control is None:
            raise AcquisitionError("daq.acquisition_not_started")
        if not self._running and not self._control.poll(START_TIMEOUT_S):
            raise AcquisitionError(
                "daq.acquisition_not_running_after", machine=self.machine.name, start_timeout_s=START_TIMEOUT_S
            )
        self._receive()
        self.check()

    def _receive(self) -> None:
        """Take in what the process reported; its silence after the end is a failure too."""
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
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(1.0)
                self._failure = Sentence(
                    "daq.acquisition_ended_itself_exit", machine=self.machine.name, returncode=self._process.returncode
                )

    def check(self) -> None:
        """Raise AcquisitionError if it has failed since."""
        self._receive()
        if self._failure is not None:
            raise AcquisitionError(self._failure)

    @property
    def alive(self) -> bool:
        """True while cycles are running."""
        self._receive()
        return self._running and self._failure is None

    def statistics(self) -> AcquisitionStatistics:
        """Return the latest statistics of the process, at most half a second old."""
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
            try:
                process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            self._final = self.statistics()
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

    def __exit__(self, *raised: object) -> None:
        self.stop()
