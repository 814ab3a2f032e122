"""Rows of ``hilfit bench faults`` about somebody else's bus, clocks and restarts: each so many times, from one seed.

Restarted are a gateway that we lead through or listen to, and acquisition's own process; the other masters are
:mod:`benchmarks.acquisition.masters`. Traces of a bus that is only listened to are made here and replayed in simulated
time: two nodes send a PDO each 20 ms whose values count, so that it is known of every value when it was on the bus.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import can
import numpy as np
from numpy.typing import NDArray

from benchmarks.acquisition import masters
from benchmarks.acquisition.channels import Devices, busy_s, machine_of
from benchmarks.acquisition.faults import unbalanced
from benchmarks.acquisition.masters import AGE_S, PATIENCE_S, Row, Seen
from benchmarks.targets import Outcome, Show, fact, figure
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.recorder import Recorder
from daq.acquisition.replay import replay
from daq.acquisition.ring import RingReader
from daq.errors import AcquisitionError
from daq.frames.frame import Frame
from daq.machine.machine_file import CanSource, Machine
from daq.quality import Quality
from daq.recordings.recording_files import read_table

NODES = 2
DOWN_S = (0.3, 2.5)  # that a gateway is away
IDLE = 0.02  # of a core that all threads but the cycle's may take meanwhile


def _until_fresh(ring: RingReader) -> tuple[float, int]:
    """Time until the first of five rows that are all fresh, s; count fresh values that are not what was sent.

    None may be between them but ones with values that only came late: that is the computer, not what was restarted.
    """
    began, first, good, wrong = time.monotonic(), 0.0, 0, 0
    while good < 5 and time.monotonic() - began < PATIENCE_S:
        ring.wait(0.5)
        for row in ring.read().rows:
            fresh = row["quality"] == Quality.FRESH
            wrong += int((fresh & (np.abs(row["values"] - VALUES) > 1e-3 * VALUES)).sum())
            if fresh.all():
                good += 1
                first = row["monotonic_ns"] / 1e9 if good == 1 else first
            elif not np.isin(row["quality"], (Quality.FRESH, Quality.LATE, Quality.STALE)).all():
                good = 0
    return (first if good >= 5 else time.monotonic()) - began, wrong


#: What every device sends, in SI: 42 bar, 42 rad, 42 degC.
VALUES = np.array([42e5, 42e5, 42.0, 42.0 + 273.15])


def _led(random: np.random.Generator) -> Seen:
    """Cut the power of the gateway and of the nodes behind it."""
    seen = Seen()
    with Devices(1, NODES) as first:
        machine = machine_of(f"led{first.pid}", first.ports[0], NODES)
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            _until_fresh(ring)
            time.sleep(random.uniform(0, 0.5))
            first.kill()
            time.sleep(random.uniform(*DOWN_S))
            with Devices(1, NODES, port=first.ports[0]):
                seen.recovery, seen.wrong = _until_fresh(ring)
    return seen


class _Gateway(threading.Thread):
    """Sends the PDOs of nodes that another master leads, to one client at a time."""

    def __init__(self, port: int = 0) -> None:
        super().__init__(daemon=True)
        self._server = socket.create_server(("127.0.0.1", port))
        self.port = self._server.getsockname()[1]
        self._ended = threading.Event()
        self.start()

    def run(self) -> None:
        """Run until it is ended."""
        self._server.settimeout(0.05)
        while not self._ended.is_set():
            with contextlib.suppress(OSError):
                client, _ = self._server.accept()
                with client:
                    client.sendall(b"< hi >")
                    for _ in range(2):
                        client.recv(100)
                        client.sendall(b"< ok >")
                    while not self._ended.wait(0.02):
                        for node in range(1, NODES + 1):
                            data = struct.pack("<ff", 42.0, 42.0).hex()
                            client.sendall(f"< frame {0x180 + node:03X} {time.time():.6f} {data} >".encode())
        self._server.close()

    def end(self) -> None:
        """Close all sockets."""
        self._ended.set()
        self.join()


def _listened(random: np.random.Generator) -> Seen:
    """Restart a gateway that is only listened to; meanwhile the process is as good as idle."""
    seen, gateway = Seen(), _Gateway()
    try:
        machine = _listening(machine_of(f"listened{gateway.port}", gateway.port, NODES))
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            _until_fresh(ring)
            time.sleep(random.uniform(0, 0.5))
            gateway.end()
            time.sleep(0.2)
            before, began = busy_s(ring.writer_pid, beside_first=True), time.monotonic()
            time.sleep(random.uniform(0.5, 2.5))
            busy = (busy_s(ring.writer_pid, beside_first=True) - before) / (time.monotonic() - began)
            seen.failed = f"{100 * busy:.1f} % of a core while it is away" if busy > IDLE else ""
            gateway = _Gateway(gateway.port)
            seen.recovery, seen.wrong = _until_fresh(ring)
    finally:
        gateway.end()
    return seen


def _killed(random: np.random.Generator) -> Seen:
    """Kill acquisition's own process while a recorder follows it; what came is sealed, and balanced."""
    seen = Seen(failed="the recorder did not notice")
    with Devices(1, NODES) as devices, tempfile.TemporaryDirectory(prefix="hilfit-bench-") as folder:
        machine = machine_of(f"killed{devices.pid}", devices.ports[0], NODES)
        path = Path(folder, "killed.parquet")
        with AcquisitionProcess(machine) as acquisition, RingReader(acquisition.ring_name) as ring:
            recorder = Recorder(acquisition.ring_name, machine, "operation", path)
            recorder.start()
            _until_fresh(ring)
            time.sleep(random.uniform(0, 1.0))
            killed = time.monotonic()
            os.kill(ring.writer_pid, signal.SIGKILL)
            try:
                recorder.wait()
            except AcquisitionError:
                seen.recovery, seen.failed = time.monotonic() - killed, ""
            seen.unbalanced = unbalanced(json.loads(read_table(path).metadata["hilfit.ledger"]))
    return seen


ROWS: dict[str, Row] = {
    "the gateway and its nodes restart": _led,
    "a gateway that is listened to restarts": _listened,
    "the acquisition process is killed": _killed,
}


PERIOD_S, SECONDS = 0.02, 10.0
BEGIN_S = 1.7e9  # of the stamps
BEHIND_S = 0.003  # SYNC
Entry = tuple[float, int, bytes]  # s from the beginning, identifier, data


def _listening(machine: Machine, sync: str = "own") -> Machine:
    """Put the machine on a bus that another master leads; its nodes' values are in one PDO each."""
    (bus,) = machine.buses
    led = bus.model_copy(update={"listen_only": True, "sync": sync})
    channels = []
    for channel in machine.channels:
        source = channel.source
        assert isinstance(source, CanSource)
        place = {"cob_id": 0x180 + source.node, "byte": 4 * (source.subindex - 1), "synchronous": sync == "external"}
        channels.append(channel.model_copy(update={"source": source.model_copy(update=place)}))
    return machine.model_copy(update={"channels": tuple(channels), "buses": (led,)})


def _pdos(moments: NDArray[np.float64]) -> Iterator[Entry]:
    """Yield the PDOs of each node, whose values are the number of the moment, and a half."""
    for node in range(1, NODES + 1):
        for k, at in enumerate(moments.tolist()):
            yield at, 0x180 + node, struct.pack("<ff", k, k + 0.5)


def _replayed(machine: Machine, entries: list[Entry]) -> list[Frame]:
    """Return what comes of a trace."""
    with tempfile.TemporaryDirectory(prefix="hilfit-bench-") as folder:
        path = Path(folder, "trace.log")
        writer = can.CanutilsLogWriter(path)
        for at, identifier, data in sorted(entries):
            message = can.Message(BEGIN_S + at, identifier, is_extended_id=False, data=data)
            writer.on_message_received(message)
        writer.stop()
        return replay(machine, path).frames


def _numbers(machine: Machine, frame: Frame) -> NDArray[np.int64]:
    """Find which moment each value is of, (n,); -1 for what is no value of ours."""
    values = [machine.conversion(c).from_si(v) for c, v in zip(machine.channels, frame.values, strict=True)]
    return np.floor(np.nan_to_num(np.array(values), nan=-1.0)).astype(np.int64)


def _aged(machine: Machine, frames: list[Frame], sampled: NDArray[np.float64]) -> int:
    """Count values called fresh that are not of a moment in ``sampled`` (s), or whose age is wrong."""
    wrong = 0
    for frame in frames:
        number = _numbers(machine, frame)
        known = (number >= 0) & (number < len(sampled))
        claimed = frame.monotonic_ns / 1e9 - BEGIN_S - frame.ages
        off = np.abs(claimed - sampled[np.where(known, number, 0)]) > AGE_S
        wrong += int(((frame.quality == Quality.FRESH) & (~known | off)).sum())
    return wrong


def _not_fresh(frames: list[Frame]) -> list[Frame]:
    """List those of which a value is not, but for the first second."""
    return [f for f in frames if f.monotonic_ns / 1e9 - BEGIN_S > 1.0 and np.any(f.quality != Quality.FRESH)]


def _grid(random: np.random.Generator) -> NDArray[np.float64]:
    return np.asarray(np.arange(round(SECONDS / PERIOD_S)) * PERIOD_S + random.uniform(0, PERIOD_S))


def _jittered(random: np.random.Generator) -> Seen:
    """Lead the cycle by another master's SYNC with jitter of up to 20 %."""
    machine = _listening(machine_of("jitter", 1, NODES), "external")
    syncs = _grid(random) + random.uniform(-0.2, 0.2, round(SECONDS / PERIOD_S)) * PERIOD_S / 2
    entries = [(at, 0x080, b"") for at in syncs.tolist()] + list(_pdos(syncs + BEHIND_S))
    frames = _replayed(machine, entries)
    # A cycle is numbered by its SYNC, and that its value is of.
    apart = [_numbers(machine, frame) - frame.cycle for frame in frames]
    usual = np.median(apart)
    wrong = sum(int(((f.quality == Quality.FRESH) & (a != usual)).sum()) for f, a in zip(frames, apart, strict=True))
    led = len(frames) >= len(syncs) - 20
    return Seen(wrong=wrong, marked=len(_not_fresh(frames)), failed="" if led else "SYNC did not lead")


def _edges(random: np.random.Generator) -> Seen:
    """Send PDOs at any phase of the replay's grid, with jitter."""
    machine = _listening(machine_of("edges", 1, NODES))
    moments = _grid(random) + random.uniform(-0.001, 0.001, round(SECONDS / PERIOD_S))
    frames = _replayed(machine, list(_pdos(moments)))
    return Seen(wrong=_aged(machine, frames, moments), marked=len(_not_fresh(frames)))


def _two_senders(random: np.random.Generator) -> Seen:
    """Let a second device begin to send the PDO of node 1."""
    machine = _listening(machine_of("two", 1, NODES))
    moments, since = _grid(random), random.uniform(2.0, 8.0)
    phase = random.uniform(0.2, 0.8) * PERIOD_S  # where it is not the first one's own moment
    strange = np.array([at + phase for at in moments if at > since])
    entries = list(_pdos(moments)) + [(at, 0x181, struct.pack("<ff", -1000.0, -1000.0)) for at in strange.tolist()]
    frames = _replayed(machine, entries)
    return Seen(wrong=_aged(machine, frames, moments), failed=_refused(frames, float(strange[0])))


def _other_length(random: np.random.Generator) -> Seen:
    """Map the PDO of node 1 anew: 4 bytes."""
    machine = _listening(machine_of("length", 1, NODES))
    moments, since = _grid(random), random.uniform(2.0, 8.0)
    entries = [(at, i, data[:4] if at > since and i == 0x181 else data) for at, i, data in _pdos(moments)]
    frames = _replayed(machine, entries)
    return Seen(wrong=_aged(machine, frames, moments), failed=_refused(frames, since))


def _refused(frames: list[Frame], since: float) -> str:
    """Test that nothing of node 1 was called fresh from half a second after ``since``, and node 2 went on."""
    later = [f.quality for f in frames[:-2] if f.monotonic_ns / 1e9 - BEGIN_S > since + 0.5]
    taken = sum(bool(np.any(quality[:2] == Quality.FRESH)) for quality in later)
    other = sum(bool(np.any(quality[2:] != Quality.FRESH)) for quality in later)
    return f"{taken} cycles of it fresh, {other} of the other node not, of {len(later)}" if taken or other else ""


def _emergency(random: np.random.Generator) -> Seen:
    """Let node 1 report an error and boot; its values are an emergency's between."""
    machine = _listening(machine_of("emergency", 1, NODES))
    moments, since = _grid(random), random.uniform(2.0, 5.0)
    boots = since + random.uniform(0.5, 3.0)
    entries = [*_pdos(moments), (since, 0x081, b"\x00\x10\x01\0\0\0\0\0"), (boots, 0x701, b"\0")]
    frames = _replayed(machine, entries)
    at = np.array([frame.monotonic_ns / 1e9 - BEGIN_S for frame in frames])
    fresh = np.array([bool(np.any(frame.quality[:2] == Quality.FRESH)) for frame in frames])
    between = fresh & (at > since + 2 * PERIOD_S) & (at < boots - 2 * PERIOD_S)
    back = at[fresh & (at > boots)]
    return Seen(
        wrong=_aged(machine, frames, moments) + int(between.sum()),
        recovery=float(back[0] - boots) if len(back) else SECONDS,
    )


TRACES: dict[str, Row] = {
    "another master's SYNC with 20 % of jitter": _jittered,
    "edges of a replay's grid": _edges,
    "two senders of one identifier": _two_senders,
    "a PDO of another length": _other_length,
    "an emergency, then a reboot": _emergency,
}


#: How many times of a row run beside each other (most of each is waiting), and what.
TABLES: tuple[tuple[int, dict[str, Row]], ...] = ((3, masters.ROWS), (3, ROWS), (1, TRACES))


def names() -> tuple[str, ...]:
    """Return the names of all rows."""
    return tuple(name for _, rows in TABLES for name in rows)


def run_rows(times: int, seed: int, only: str | None, show: Show) -> Outcome:
    """Run every row so many times at random moments."""
    notes = [f"{'row':48s} ours  wrong  marked (excused)  heard, worst  recovery, worst    took"]
    seen: list[Seen] = []
    seeds = dict(zip(names(), np.random.SeedSequence(seed).spawn(len(names())), strict=True))
    for at_once, rows in TABLES:
        for name, row in rows.items():
            if only is not None and only not in name:
                continue
            began = time.monotonic()
            with ThreadPoolExecutor(at_once) as pool:
                found = list(pool.map(row, map(np.random.default_rng, seeds[name].spawn(times))))
            seen += found
            notes.append(_line(name, found, time.monotonic() - began))
            show(notes[-1])
            notes += [f"    {one.failed}" for one in found if one.failed][:3]
    marked = [one.marked for one in seen if one.marked is not None]
    recoveries = [one.recovery for one in seen if one.recovery is not None]
    frames, wrong = sum(one.frames for one in seen), sum(one.wrong for one in seen)
    failed = sum(bool(one.failed) for one in seen)
    return Outcome(
        (
            figure("frames of ours after another master's first", frames, most=0),
            figure("wrong values called fresh", wrong, most=0),
            figure("cycles marked, at most", max(marked, default=0), most=1),
            figure("slowest recovery", max(recoveries, default=0.0), "{:.2f} s", most=2.0),
            fact("as it should be every time", not failed, f"{len(seen) - failed} of {len(seen)}"),
            fact("produced = stored + dropped", not sum(one.unbalanced for one in seen), f"{times} times each"),
        ),
        tuple(notes),
    )


def _line(name: str, found: Sequence[Seen], took: float) -> str:
    detected, recovery = (
        f"{max(known):.2f} s" if (known := [t for t in times if t is not None]) else "-"
        for times in ([one.detected for one in found], [one.recovery for one in found])
    )
    marked = [one.marked for one in found if one.marked is not None]
    excused = sum(one.excused for one in found)
    counts = f"{max(marked)} ({excused})" if marked else "-"
    return (
        f"{name:48s} {sum(one.frames for one in found):4d} {sum(one.wrong for one in found):6d} "
        f"{counts:>16s} {detected:>13s} {recovery:>16s} {took:5.0f} s"
    )
