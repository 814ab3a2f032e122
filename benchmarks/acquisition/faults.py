"""Every fault of the simulated machine at random moments, on CANopen, Modbus TCP and RTU.

In lockstep, so that nothing is lost because the computer is busy: while a device is waited for, the machine is
halted, and that time does not count. At the wall's clock (``real_time``) everything counts, on a quiet computer.

The plant idles with a known seed, so what every sensor measured at every SYNC is known here without asking anybody; its
noise makes each sample different from its neighbours, so that a value of another SYNC is recognised. A recorder runs
all the time; its ledger is looked at in the end.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from benchmarks.targets import Check, Outcome, Show, fact, figure
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.recorder import Recorder, RecordingSummary
from daq.acquisition.ring import RingReader
from daq.errors import HilfitError
from daq.frames.channels import channel_table
from daq.machine.machine_file import Machine, ModbusRtuBus, ModbusSource, Simulation, load_machine
from daq.quality import Quality
from fitting.arrays import BoolArray, FloatArray
from sim_backends import Plant, SimulatedMachine, default_machine
from sim_backends.faults.fault_file import Fault, fault_problems, targets
from sim_backends.faults.fault_runner import apply
from sim_backends.plant.plant_process import BLOCK

SEED = 11
WARM_UP_S = 7.0  # frozen values are detected by what is normal, and that takes five seconds to learn
PAUSE_S = (0.2, 0.8)  # between recovery and the next fault
LASTS_S = (0.4, 1.0)
PATIENCE_LOCKSTEP_S = 0.4  # that the machine is halted for a device that does not answer
STANDS_STILL_S = 0.1  # a longer time between two frames is no time of the machine
RECOVERY_S = 2.0
PATIENCE_S = 60.0  # for a recovery that does not come
SETTLED = 10  # rows in a row that are fresh on all channels: recovered
SYNCS_AHEAD = 12  # among which the one is looked for that a row belongs to
TOLERANCE = 2e-5  # of a value, for what float32 makes of it
PLACES = 6  # wrong values of one fault that are listed one by one
NO_SYNC = 1_000
SERIAL = "line"
BUSES = {"can": "CANopen", "modbus": "Modbus TCP", SERIAL: "Modbus RTU"}
NS = 1_000_000_000
#: What a sensor reports that is wrong, and its device does not know: one value alone does not show it.
UNKNOWABLE = ("noise_burst", "bias_step")
#: Without SYNC machine time is halted, and what is polled with it.
STOPS_ALL = ("bus_off", "half_open")


def _machine_of_three_buses() -> tuple[Machine, Any]:
    """Make the folding arm with two of its Modbus units on a serial line, and its truth."""
    machine, truth = default_machine()
    channels = []
    for channel in machine.channels:
        source = channel.source
        if isinstance(source, ModbusSource) and source.unit in (5, 6):
            channel = channel.model_copy(update={"source": source.model_copy(update={"bus": SERIAL})})
        channels.append(channel)
    line = ModbusRtuBus(name=SERIAL, type="modbus_rtu", port="/dev/ttyS0", timeout_s=0.1)
    return machine.model_copy(update={"channels": tuple(channels), "buses": (*machine.buses, line)}), truth


def names() -> tuple[str, ...]:
    """Return the names of all faults, each with its bus."""
    return tuple(name for name, _ in _faults_of(_machine_of_three_buses()[0]))


def _faults_of(machine: Machine) -> tuple[tuple[str, Fault], ...]:
    """List name and content of every fault, on every bus that can have it, checked against the machine."""
    text = Path(__file__).with_name("faults.yaml").read_text(encoding="utf-8")
    script, problems = fault_problems(text, machine)
    if script is None:
        raise RuntimeError(problems[0].under("faults.yaml"))
    buses = {c.name: c.source.bus for c in machine.channels if c.source is not None}
    found = []
    for content, fault in zip(yaml.safe_load(text)["faults"], script.faults, strict=True):
        bus = content.get("bus") or buses[content["channel"]]
        size = content.get("share", content.get("seconds", content.get("syncs")))
        found.append((f"{BUSES[bus]}: {content['fault']}{'' if size is None else f' {size:g}'}", fault))
    return tuple(found)


@dataclass
class _Case:
    """Outcome of one fault, each time that it came.

    Attributes
    ----------
    spans : when it began, when it ended, when all was fresh again (monotonic ns; None: not within the patience)
    recoveries : seconds of the machine from each end to when all was fresh again
    wrong : values called fresh that are not what was there at their SYNC
    others : values of other devices that were not fresh while it lasted and until all had recovered
    mates : the same of devices that share its serial line, which a time-out keeps busy
    cost : values of its own device or bus that were not fresh
    places : where the first wrong values are, and the first ones that others lost, in words
    """

    name: str
    fault: Fault
    costs: frozenset[str]
    mates_of: frozenset[str]
    spans: list[tuple[int, int, int | None]] = field(default_factory=list)
    recoveries: list[float] = field(default_factory=list)
    wrong: int = 0
    others: int = 0
    mates: int = 0
    cost: int = 0
    places: list[str] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """The fault's name."""
        return str(self.fault.model_dump()["fault"])


class _Bench:
    """A running simulated machine, its acquisition, its recorder, and every frame since the start."""

    def __init__(self, stack: ExitStack, real_time: bool) -> None:
        directory = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="hilfit-bench-")))
        self.declared, self.truth = _machine_of_three_buses()
        machine = SimulatedMachine(self.declared, self.truth, seed=SEED, workdir=directory / "sim")
        self.machine = stack.enter_context(machine)
        how = None if real_time else Simulation(speed=1.0, lockstep=True, patience_s=PATIENCE_LOCKSTEP_S)
        acquired = load_machine(self.machine.machine_path).model_copy(update={"simulation": how})
        self.acquisition = stack.enter_context(AcquisitionProcess(acquired, ring_seconds=600))
        self._reader = stack.enter_context(RingReader(self.acquisition.ring_name, from_start=True))
        self.recorder = Recorder(self.acquisition.ring_name, acquired, "operation", directory / "faults.parquet")
        self.recorder.start()
        self.rows: list[npt.NDArray[np.void]] = []

    def read(self, seconds: float) -> npt.NDArray[np.void]:
        """Let so much time pass; return the frames that came."""
        time.sleep(seconds)
        self.acquisition.check()
        found = self._reader.read()
        if found.missed:
            raise RuntimeError(f"the benchmark itself lost {found.missed} frames")
        self.rows.append(found.rows)
        return found.rows

    def recovered(self, since_ns: int) -> int | None:
        """Find when the first of :data:`SETTLED` rows in a row was fresh on all channels; None: not in time."""
        run, first = 0, 0
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for row in self.read(0.05):
                if row["monotonic_ns"] < since_ns:
                    continue
                if not np.all(row["quality"] == Quality.FRESH):
                    run = 0
                    continue
                run += 1
                first = int(row["monotonic_ns"]) if run == 1 else first
                if run == SETTLED:
                    return first
        return None


def run(times: int, seed: int, only: str | None, real_time: bool, show: Show) -> Outcome:
    """Cause every fault so many times and measure what it cost."""
    random = np.random.default_rng(seed)
    with ExitStack() as stack:
        bench = _Bench(stack, real_time)
        cases = [case for case in _cases(bench.declared) if only is None or only in case.name]
        broken = ""
        try:
            bench.read(WARM_UP_S)
            for case in cases:
                for _ in range(times):
                    _one(bench, case, random)
                show(f"{case.name:32s} {times} times")
        except HilfitError as error:  # what came until then counts all the same
            broken = str(error)
        summary = bench.recorder.stop()
        rows = np.concatenate(bench.rows)
        skipped = bench.acquisition.statistics().skipped
        _judge(cases, rows, bench)
    outcome = _outcome([case for case in cases if case.spans], rows, summary, skipped, bench.declared)
    ran = fact("came as often as asked", not broken, f"{times} times each" if not broken else f"broke off: {broken}")
    return Outcome((ran, *outcome.checks), outcome.notes)


def _cases(machine: Machine) -> Iterator[_Case]:
    buses = {c.name: c.source.bus for c in machine.channels if c.source is not None}
    for name, fault in _faults_of(machine):
        costs = targets(fault, machine)
        if fault.model_dump()["fault"] in STOPS_ALL and name.startswith("CANopen"):
            costs = frozenset(buses)
        mates = frozenset(c for c, bus in buses.items() if bus == SERIAL and SERIAL in {buses[k] for k in costs})
        yield _Case(name, fault, costs, mates - costs)


def _one(bench: _Bench, case: _Case, random: np.random.Generator) -> None:
    bench.recovered(time.monotonic_ns())
    bench.read(random.uniform(*PAUSE_S))
    began = time.monotonic_ns()
    apply(bench.machine, bench.declared, case.fault, on=True)
    bench.read(random.uniform(*LASTS_S))
    apply(bench.machine, bench.declared, case.fault, on=False)
    ended = time.monotonic_ns()
    case.spans.append((began, ended, bench.recovered(ended)))


def _judge(cases: Sequence[_Case], rows: npt.NDArray[np.void], bench: _Bench) -> None:
    """Count, in the time of each fault, what was lost and what was wrong."""
    names = channel_table(bench.declared).names
    wrong, apart = _wrong_values(rows, bench.declared, bench.truth)
    lost = ~np.isin(rows["quality"], (Quality.FRESH, Quality.HELD))
    at = rows["monotonic_ns"]
    for case in cases:
        own = np.array([name in case.costs for name in names])
        mates = np.array([name in case.mates_of for name in names])
        for began, ended, back in case.spans:
            case.recoveries.append(PATIENCE_S if back is None else _machine_seconds(at, ended, back))
            during = (at >= began) & (at <= (at[-1] if back is None else back))
            case.wrong += int(wrong[during].sum())
            if case.kind not in (*UNKNOWABLE, "freeze"):
                case.places += _wrong_places(wrong & during[:, None], apart, rows, names, began)
            case.cost += int(lost[during][:, own].sum())
            case.mates += int(lost[during][:, mates].sum())
            case.others += int(lost[during][:, ~own & ~mates].sum())
            case.places += _lost_places(lost & during[:, None] & ~own & ~mates, rows)


def _machine_seconds(at: npt.NDArray[np.int64], since: int, until: int) -> float:
    """Compute the seconds between two moments without those in which the machine was halted."""
    moments = np.concatenate([[since], at[(at > since) & (at <= until)]])
    return float(np.minimum(np.diff(moments) / NS, STANDS_STILL_S).sum())


def _lost_places(lost: BoolArray, rows: npt.NDArray[np.void]) -> list[str]:
    """List where values are lost, and how long the cycle took: all, after the patience, is a computer too busy."""
    took = np.diff(rows["monotonic_ns"], append=rows["monotonic_ns"][-1]) / NS
    cycles = np.flatnonzero(lost.any(axis=1))[:PLACES]
    return [f"others: cycle {rows['cycle'][k]}, {lost[k].sum()} values, it took {took[k]:.3f} s" for k in cycles]


def _wrong_places(
    wrong: BoolArray, apart: npt.NDArray[np.int64], rows: npt.NDArray[np.void], names: Sequence[str], began: int
) -> list[str]:
    """List wrong values: cycle, channel, time since the fault began, and which SYNC's they really are."""
    found = []
    for row, channel in np.argwhere(wrong)[:PLACES]:
        lag = int(apart[row, channel])
        whose = "of no SYNC near" if lag == NO_SYNC else f"of SYNC {lag:+d}"
        after_s = (int(rows["monotonic_ns"][row]) - began) / NS
        found.append(f"wrong: cycle {rows['cycle'][row]}, {names[channel]}, {after_s:.3f} s after it began: {whose}")
    return found


def _measured(machine: Machine, truth: Any, periods: int) -> FloatArray:
    """Compute what the idle plant measures from power-on, (at least ``periods``, n), in its process' blocks.

    In other blocks it rounds otherwise, and of ten thousand pressures one then differs by more than it is read with.
    """
    plant = Plant(machine, truth, rng=np.random.default_rng(SEED))
    blocks = [plant.advance(1), *(plant.advance(BLOCK) for _ in range(-(-periods // BLOCK)))]
    return np.asarray(np.concatenate(blocks))


def _wrong_values(rows: npt.NDArray[np.void], machine: Machine, truth: Any) -> tuple[BoolArray, npt.NDArray[np.int64]]:
    """Mark (N, n) values called fresh that are not what the plant measured at the SYNC of their row.

    Which SYNC that is, most values of the row show: a cycle sends one, but none while the bus is down. The
    second array has, where a value is wrong, how many SYNCs before (negative) or after it is one (:data:`NO_SYNC`:
    none near).
    """
    states = _measured(machine, truth, int(rows["cycle"][-1]) + 200)
    fresh = rows["quality"] == Quality.FRESH
    found = np.zeros(fresh.shape, dtype=np.bool_)
    apart = np.full(fresh.shape, NO_SYNC, dtype=np.int64)
    sync = 0
    for number, (values, good) in enumerate(zip(rows["values"], fresh, strict=True)):
        if not good.any():
            continue
        errors = np.abs(states[sync : sync + SYNCS_AHEAD] - values)[:, good]
        agree = errors <= TOLERANCE * np.maximum(np.abs(values[good]), 1.0)
        best = int(np.argmax(agree.sum(axis=1)))
        sync += best
        found[number, np.flatnonzero(good)] = ~agree[best]
        for channel in np.flatnonzero(found[number]):
            near = states[max(0, sync - SYNCS_AHEAD) : sync + SYNCS_AHEAD, channel]
            same = np.abs(near - values[channel]) <= TOLERANCE * max(abs(values[channel]), 1.0)
            if same.any():
                apart[number, channel] = int(np.argmax(same)) - min(sync, SYNCS_AHEAD)
    return found, apart


def unbalanced(ledger: Mapping[str, Any]) -> int:
    """Count the channels of which produced is not stored + dropped."""
    return sum(own["produced"] != own["stored"] + sum(own["dropped"].values()) for own in ledger.values())


def _balance(summary: RecordingSummary) -> Check:
    shown = f"{len(summary.ledger)} channels, {summary.rows} rows"
    return fact("produced = stored + dropped", not unbalanced(summary.ledger), shown)


def _outcome(
    cases: Sequence[_Case], rows: npt.NDArray[np.void], summary: RecordingSummary, skipped: int, machine: Machine
) -> Outcome:
    notes = [f"{'fault':32s} values lost: own  others  on its line   wrong  recovery median, worst"]
    for case in cases:
        times = case.recoveries
        notes.append(
            f"{case.name:32s} {case.cost:16d} {case.others:7d} {case.mates:12d} {case.wrong:7d}"
            f"  {statistics.median(times):6.2f} s {max(times):6.2f} s"
        )
        notes += [f"    {place}" for place in case.places]
    faults = sum(len(case.spans) for case in cases)
    honest = [case for case in cases if case.kind not in (*UNKNOWABLE, "freeze")]
    frozen = [case for case in cases if case.kind == "freeze"]
    lying = [case for case in cases if case.kind in UNKNOWABLE]
    worst = max(max(case.recoveries) for case in cases)
    covered = np.zeros(len(rows), dtype=np.bool_)
    for case in cases:
        for began, _, back in case.spans:
            covered |= (rows["monotonic_ns"] >= began) & (rows["monotonic_ns"] <= (back or rows["monotonic_ns"][-1]))
    quiet = int((rows["quality"][~covered] != Quality.FRESH).sum())
    checks = [
        _balance(summary),
        figure("wrong values called fresh", sum(c.wrong for c in honest), most=0),
        figure("values lost by other devices", sum(c.others for c in cases), most=0),
        figure("slowest recovery", worst, "{:g} s", most=RECOVERY_S, shown=f"{worst:.2f} s of {faults}"),
        figure("cycles skipped", skipped, most=0, shown=f"{skipped} of {len(rows)}"),
        figure("values lost beside the faults", quiet),
        figure("values lost on the fault's own serial line", sum(c.mates for c in cases)),
    ]
    if frozen:
        most = max(case.wrong / len(case.spans) for case in frozen)
        checks.append(figure("equal values until one is called frozen", most, "{:.1f} per fault"))
    if lying:
        count = sum(case.wrong for case in lying)
        checks.append(figure("wrong values of a sensor that lies", count, "{:g}; no single value tells"))
    load = os.getloadavg()[0]
    notes.append(f"load of the computer {load:.1f} on {os.cpu_count()} cores, {machine.rate_hz:g} Hz")
    return Outcome(tuple(checks), tuple(notes))


BETWEEN_S = (0.5, 3.0)
SETTLED_SHARE = 0.25  # of the time, after which memory is compared
GROWTH_MB = 8.0  # that pools of the allocator may still fill up by
_MB = 2.0**20


def _resident(pid: int) -> float:
    """Read the resident memory of a process in bytes, without what it shares (proc(5): statm).

    The ring is shared: it is resident as far as it was ever written to, which takes its ten minutes of machine time.
    """
    _, whole, shared, *_ = Path(f"/proc/{pid}/statm").read_text().split()
    return (int(whole) - int(shared)) * os.sysconf("SC_PAGE_SIZE")


def soak(minutes: float, seed: int, show: Show) -> Outcome:
    """Cause faults at random for so long."""
    random = np.random.default_rng(seed)
    with ExitStack() as stack:
        bench = _Bench(stack, real_time=False)
        faults = _faults_of(bench.declared)
        with RingReader(bench.acquisition.ring_name) as ring:
            acquisition = ring.writer_pid
        bench.read(WARM_UP_S)
        began, memory, count, unrecovered = time.monotonic(), [], 0, 0
        shown_at = began
        while (now := time.monotonic()) - began < 60 * minutes:
            name, fault = faults[int(random.integers(len(faults)))]
            apply(bench.machine, bench.declared, fault, on=True)
            bench.read(random.uniform(*LASTS_S))
            apply(bench.machine, bench.declared, fault, on=False)
            count += 1
            if bench.recovered(time.monotonic_ns()) is None:
                unrecovered += 1
                show(f"{name}: not all fresh again after {PATIENCE_S:g} s")
            bench.read(random.uniform(*BETWEEN_S))
            bench.rows.clear()  # a recording of hours is the recorder's business, not this process's
            memory.append((now - began, _resident(acquisition)))
            if now - shown_at > 60:
                shown_at = now
                show(f"{(now - began) / 60:5.0f} min, {count} faults, acquisition has {memory[-1][1] / _MB:.0f} MB")
        statistics = bench.acquisition.statistics()
        summary = bench.recorder.stop()
    settled = [size for at, size in memory if at >= SETTLED_SHARE * 60 * minutes]
    growth = (settled[-1] - settled[0]) / _MB
    grown = f"{growth:+.1f} MB after the first quarter, {settled[-1] / _MB:.0f} MB at the end"
    checks = (
        _balance(summary),
        figure("frames that are not in the recording", summary.missed_cycles, most=0),
        figure("cycles skipped", statistics.skipped, most=0),
        figure("faults that were not overcome", unrecovered, most=0, shown=f"{unrecovered} of {count}"),
        figure("growth of acquisition's memory", growth, "{:g} MB", most=GROWTH_MB, shown=grown),
    )
    return Outcome(checks, (f"{minutes:g} min, load of the computer {os.getloadavg()[0]:.1f}",))
