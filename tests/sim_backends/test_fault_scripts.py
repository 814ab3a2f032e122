"""Fault scripts against the whole acquisition: the ledger balances, what is fresh is true, one fault costs one device.

The plant idles with a known seed, so what every channel measures at every SYNC is known without asking anybody; its
noise makes each sample different from its neighbours, so that a value of another SYNC is recognised.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import machine_faults as faults
import numpy as np
import pytest

from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.recorder import Recorder
from daq.acquisition.ring import RingReader
from daq.frames.channels import channel_table
from daq.machine.machine_file import CanSource
from daq.quality import Quality
from daq.recordings.recording_files import read_table
from sim_backends import Plant, SimulatedMachine, default_machine
from sim_backends.plant.plant_process import BLOCK

pytestmark = pytest.mark.slow

SEED = 11
MACHINE, TRUTH = default_machine()
TABLE = channel_table(MACHINE)
NODE = 31  # a pressure transducer
OF_NODE = [i for i, c in enumerate(MACHINE.channels) if isinstance(c.source, CanSource) and c.source.node == NODE]
MODBUS = [i for i, c in enumerate(MACHINE.channels) if not isinstance(c.source, CanSource)]
UNIT = MACHINE.channels[MODBUS[0]].source.unit if MODBUS else 0
OF_UNIT = [i for i in MODBUS if MACHINE.channels[i].source.unit == UNIT]
BUS = next(bus.name for bus in MACHINE.buses if bus.type != "canopen")


@dataclass(frozen=True)
class Script:
    """A fault, its end, the channels that it may cost something, and what the event log calls it."""

    begin: Callable[[SimulatedMachine], object]
    end: Callable[[SimulatedMachine], object]
    costs: list[int]
    event: str = ""
    cycles: int = 30


def nothing(machine: SimulatedMachine) -> None:
    """The fault is over by itself."""


SCRIPTS = {
    "lost TPDOs": Script(lambda m: faults.lose_tpdos(m, NODE, 1), nothing, OF_NODE, cycles=3),
    "node dies": Script(lambda m: faults.kill_node(m, NODE), lambda m: faults.revive_node(m, NODE), OF_NODE, "silent"),
    "node reboots": Script(lambda m: faults.reset_node(m, NODE), nothing, OF_NODE, "boot_up"),
    "NaN": Script(lambda m: faults.not_a_number(m, NODE), lambda m: faults.not_a_number(m, NODE, False), OF_NODE),
    "frozen": Script(lambda m: faults.freeze_node(m, NODE), lambda m: faults.freeze_node(m, NODE, False), OF_NODE),
    "doubled": Script(
        lambda m: faults.double_node(m, NODE), lambda m: faults.double_node(m, NODE, False), OF_NODE, "failed"
    ),
    "EMCY storm": Script(
        lambda m: faults.emergency_storm(m, NODE), lambda m: faults.emergency(m, NODE, 0, 0), OF_NODE, "emergency"
    ),
    "garbled SDO after a reboot": Script(
        lambda m: (faults.garble_sdo(m, NODE), faults.reset_node(m, NODE)),
        lambda m: faults.garble_sdo(m, NODE, False),
        OF_NODE,
        "boot_up",
    ),
    "strangers": Script(
        lambda m: [
            faults.inject(m, 0x180 + NODE, bytes(8), extended=True),
            faults.inject(m, 0x580 + NODE, b"\x43"),
            faults.error_frame(m),
        ],
        nothing,
        [],
    ),
    "bus-off": Script(lambda m: faults.error_frame(m, 0x040), nothing, list(range(len(TABLE.names))), "bus_off"),
    "hub drops its clients": Script(faults.drop_can_clients, nothing, list(range(len(TABLE.names))), "bus_down"),
    "exception": Script(
        lambda m: faults.exception_unit(m, BUS, UNIT, 6), lambda m: faults.exception_unit(m, BUS, UNIT, None), OF_UNIT
    ),
}


class Run:
    """An acquisition of the simulated machine, its frames from the start, and its recording."""

    def __init__(self, machine: SimulatedMachine, acquisition: AcquisitionProcess, recorder: Recorder) -> None:
        self.machine, self.acquisition, self.recorder = machine, acquisition, recorder
        self._reader = RingReader(acquisition.ring_name, from_start=True)
        self.rows: list[np.ndarray] = []

    def read(self) -> np.ndarray:
        """The frames that came since."""
        assert self._reader.wait(60)
        found = self._reader.read()
        assert found.missed == 0
        self.rows.append(found.rows)
        return found.rows

    def cycles(self, count: int) -> None:
        """Let so many cycles pass."""
        while count > 0:
            count -= len(self.read())

    def until_fresh(self) -> None:
        """Let cycles pass until every channel is fresh."""
        for _ in range(3000):
            if np.all(self.read()["quality"][-1] == Quality.FRESH):
                return
        raise AssertionError(f"does not recover: {self.acquisition.statistics().buses}")

    def close(self) -> None:
        """Let go of the ring."""
        self._reader.close()


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Iterator[Run]:
    directory = tmp_path_factory.mktemp("faults")
    with (
        SimulatedMachine(MACHINE, TRUTH, seed=SEED, speed=4.0, workdir=directory / "machine") as machine,
        AcquisitionProcess(machine.machine_path, ring_seconds=600) as acquisition,
    ):
        recorder = Recorder(acquisition.ring_name, acquisition.machine, "operation", directory / "r.parquet")
        recorder.start()
        made = Run(machine, acquisition, recorder)
        made.until_fresh()
        made.cycles(300)  # frozen values are known by what is normal
        yield made
        made.close()


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_fault_costs_only_its_device_and_is_overcome(run: Run, name: str) -> None:
    script = SCRIPTS[name]
    run.until_fresh()
    before = len(run.rows)
    script.begin(run.machine)
    run.cycles(script.cycles)
    script.end(run.machine)
    run.cycles(2)
    run.until_fresh()
    rows = np.concatenate(run.rows[before:])
    others = [i for i in range(len(TABLE.names)) if i not in script.costs]
    assert np.all(rows["quality"][:, others] == Quality.FRESH), "another device lost a cycle"
    assert np.all(np.diff(rows["cycle"]) == 1)


def test_every_value_is_accounted_for_and_what_is_fresh_is_true(run: Run) -> None:
    run.until_fresh()
    summary = run.recorder.stop()
    assert summary.warnings == ()
    for name, entry in summary.ledger.items():
        assert entry["produced"] == entry["stored"] + sum(entry["dropped"].values()), name
        assert entry["produced"] == summary.rows
    found = read_table(summary.path)
    seen = {event["what"] for event in json.loads(found.metadata["hilfit.events"])}
    assert {script.event for script in SCRIPTS.values() if script.event} <= seen

    rows = np.concatenate(run.rows)
    plant = Plant(MACHINE, TRUTH, rng=np.random.default_rng(SEED))
    # In the blocks of the plant's process: in others it rounds otherwise, and one pressure of ten thousand differs.
    blocks = [plant.advance(1), *(plant.advance(BLOCK) for _ in range(int(rows["cycle"][-1]) // BLOCK + 10))]
    states = np.concatenate(blocks)
    fresh = rows["quality"] == Quality.FRESH
    # Each cycle sends one SYNC, none while the bus is down, and some more when it was opened: which one a frame belongs
    # to is what most of its values say. A value that says another one is called fresh and is not.
    sync = 0
    wrong = np.zeros(len(TABLE.names), dtype=int)
    for row, good in zip(rows, fresh, strict=True):
        if not good.any():
            continue
        errors = np.abs(states[sync : sync + 8] - row["values"])[:, good]
        agree = errors <= 2e-5 * np.maximum(np.abs(row["values"][good]), 1.0)
        best = int(np.argmax(agree.sum(axis=1)))
        sync += best
        wrong[np.flatnonzero(good)] += ~agree[best]
    named = {TABLE.names[i]: int(count) for i, count in enumerate(wrong) if count}
    # That a sensor hangs shows only after a while: the tenth equal value in a row is the first that is called frozen.
    assert all(count < 10 and name in [TABLE.names[i] for i in OF_NODE] for name, count in named.items()), named
