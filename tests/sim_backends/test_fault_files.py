"""Fault files: what they may say, what is wrong with one in a line each, and what is ordered when."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import sim_backends.machines
from daq.errors import InputError
from sim_backends import default_machine
from sim_backends.devices.canopen_nodes import FaultyLine
from sim_backends.devices.signal_faults import KINDS, SignalFaults
from sim_backends.faults.fault_file import FAULTS, FaultScript, fault_problems, load_faults, targets
from sim_backends.faults.fault_runner import FaultRunner, apply

MACHINE, _ = default_machine()
EXAMPLE = Path(sim_backends.machines.__file__).with_name("faults.yaml")


class Orders:
    """Takes orders and remembers them."""

    def __init__(self) -> None:
        self.given: list[tuple[str, str, dict[str, Any]]] = []

    def order(self, process: str, order: str, **details: Any) -> Any:
        self.given.append((process, order, details))
        return {"sync": 1} if order == "counts" else None


def script(*faults: dict[str, Any]) -> FaultScript:
    return FaultScript.model_validate({"schema": "hilfit/faults/1", "faults": list(faults)})


def lines(text: str) -> list[str]:
    return [problem.under("f.yaml") for problem in fault_problems(text, MACHINE)[1]]


def test_the_example_shows_every_fault() -> None:
    shown = {fault.model_dump()["fault"] for fault in load_faults(EXAMPLE, MACHINE).faults}
    assert shown == set(FAULTS)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("fault: node_deth, bus: can, node: 31", "f.yaml:3: faults[0].fault: there is no fault 'node_deth'; did you"),
        ("bus: can, node: 31", "faults[0].fault: this key is missing"),
        ("fault: drop, bus: can, node: 99", "faults[0].node: bus 'can' has no node 99; there are 11, 12"),
        ("fault: drop, bus: modbus, unit: 99", "faults[0].unit: bus 'modbus' has no unit 99; there are 4"),
        ("fault: drop, bus: modbus, node: 31", "'modbus' is modbus_tcp; write 'unit'"),
        ("fault: drop, bus: can, unit: 4", "'can' is canopen; write 'node'"),
        ("fault: drop, bus: can", "give either 'node' (CANopen) or 'unit' (Modbus)"),
        ("fault: drop, bus: can, node: 31, share: 3", "faults[0].share: must be 1 or less"),
        ("fault: drop, bus: can, node: 31, shar: 0.3", "faults[0].shar: unknown key; did you mean 'share'?"),
        ("fault: delay, bus: can, node: 31, seconds: 1", "give 'syncs' for a node"),
        ("fault: bus_off, bus: modbus", "'modbus' is modbus_tcp; this fault needs a CANopen bus"),
        ("fault: bus_off, bus: cann", "has no bus 'cann'; did you mean 'can'?"),
        ("fault: nan, channel: joint1.angle", "is uint32, which has no NaN; choose a float one"),
        ("fault: saturate, channel: joint1.angle", "has no range that it could saturate at"),
        ("fault: freeze, channel: joint1.angel", "has no channel 'joint1.angel'; did you mean 'joint1.angle'?"),
        ("fault: freeze, channel: joint1.angle, every: 1", "every: 1 s is no longer than for: 2 s"),
    ],
)
def test_a_mistake_is_one_line_that_names_its_place(entry: str, says: str) -> None:
    found = lines(f"schema: hilfit/faults/1\nfaults:\n  - {{at: 1, for: 2, {entry}}}\n")
    assert len(found) == 1 and says in found[0] and "\n" not in found[0]
    assert found[0].startswith("f.yaml:3: faults[0]")


def test_every_mistake_has_its_line() -> None:
    found = lines(
        "schema: hilfit/faults/1\nfaults:\n"
        "  - {at: -1, for: 2, fault: bus_off, bus: can}\n"
        "  - {at: 1, for: 0, fault: bus_off, bus: can}\n"
        "  - {at: 1, for: 1, fault: gone, bus: can}\n"
    )
    assert sorted(line.split(":")[1] for line in found) == ["3", "4", "5"]


@pytest.mark.parametrize("text", ["", "[1", "schema: hilfit/machine/1", "- 1", "schema: hilfit/faults/1\nfaults: 3"])
def test_what_is_no_fault_file_is_said_in_a_line(text: str) -> None:
    assert len(lines(text)) == 1


def test_a_file_that_is_not_there_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file; give a fault file"):
        load_faults(tmp_path / "none.yaml", MACHINE)


def test_the_command_lists_all_mistakes_and_ends_with_2(tmp_path: Path) -> None:
    import typer

    from sim_backends.cli import register

    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)
    file = tmp_path / "f.yaml"
    file.write_text(
        "schema: hilfit/faults/1\nfaults:\n"
        "  - {at: 1, for: 2, fault: bus_off, bus: a}\n  - {at: 1, for: 2, fault: bus_off, bus: b}\n"
    )
    machine = str(EXAMPLE.with_name("folding_arm.yaml"))
    result = CliRunner().invoke(app, ["simulate", machine, "--faults", str(file)])
    assert result.exit_code == 2
    assert [line.split(": ")[1] for line in result.stderr.splitlines()] == [f"{file}:3", f"{file}:4"]


def test_targets_are_the_channels_of_the_device_the_bus_or_the_signal() -> None:
    faults = script(
        {"at": 0, "for": 1, "fault": "drop", "bus": "can", "node": 31},
        {"at": 0, "for": 1, "fault": "half_open", "bus": "modbus"},
        {"at": 0, "for": 1, "fault": "freeze", "channel": "joint2.angle"},
    ).faults
    device, bus, signal = (targets(fault, MACHINE) for fault in faults)
    assert device == {"joint1.head_pressure", "joint1.rod_pressure"}
    assert bus == {c.name for c in MACHINE.channels if c.source is not None and c.source.bus == "modbus"}
    assert signal == {"joint2.angle"}


@pytest.mark.parametrize("number", range(len(FAULTS)))
def test_what_begins_ends_with_the_same_process(number: int) -> None:
    fault = load_faults(EXAMPLE, MACHINE).faults[number]
    first, second = Orders(), Orders()
    apply(first, MACHINE, fault, on=True)
    apply(second, MACHINE, fault, on=False)
    assert [process for process, _, _ in first.given] == [process for process, _, _ in second.given] != []
    assert first.given != second.given


def test_sizes_are_in_the_channel_s_unit() -> None:
    """A pressure in bar whose device sends bar: 5 bar are 5; saturated is the range's upper end, 250 bar."""
    for fault, size in (({"fault": "bias_step", "size": 5.0}, 5.0), ({"fault": "saturate"}, 250.0)):
        orders = Orders()
        apply(
            orders, MACHINE, script({"at": 0, "for": 1, "channel": "joint1.head_pressure", **fault}).faults[0], on=True
        )
        assert orders.given[0][2]["size"] == pytest.approx(size)


def test_a_script_is_run_in_order_repeated_and_written_down(tmp_path: Path) -> None:
    orders, log = Orders(), tmp_path / "faults.jsonl"
    faults = script(
        {"at": 0.06, "for": 0.02, "fault": "bus_off", "bus": "can"},
        {"at": 0.0, "for": 0.02, "every": 0.05, "fault": "sync_jitter", "bus": "can", "seconds": 0.01},
    ).faults
    runner = FaultRunner(orders, MACHINE, faults, log)
    runner.start()
    deadline = time.monotonic() + 10
    while not log.exists() or log.read_text().count("\n") < 8:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    runner.stop()
    told = [json.loads(line) for line in log.read_text().splitlines()]
    steps = [(entry["fault"]["fault"], entry["what"]) for entry in told]
    assert steps[:2] == [("sync_jitter", "begin"), ("sync_jitter", "end")]
    assert steps.count(("sync_jitter", "begin")) >= 2 and steps.count(("bus_off", "begin")) == 1
    for name in ("sync_jitter", "bus_off"):
        own = [what for fault, what in steps if fault == name]
        assert own == ["begin", "end"] * (len(own) // 2) + ["begin"] * (len(own) % 2)
    assert [entry["utc_ns"] for entry in told] == sorted(entry["utc_ns"] for entry in told)


@given(st.lists(st.tuples(st.sampled_from(KINDS), st.booleans()), max_size=20), st.floats(-1e6, 1e6))
def test_a_sensor_is_right_again_when_all_its_faults_have_ended(steps: list[tuple[str, bool]], raw: float) -> None:
    signals = SignalFaults(1)
    on: set[str] = set()
    for kind, begins in steps:
        signals.set("a", kind, 3.0, begins)
        (on.add if begins else on.discard)(kind)
        said = signals.apply("a", raw)
        assert math.isnan(said) == ("nan" in on)
        if "saturate" in on and "nan" not in on:
            assert said == 3.0
        assert signals.apply("b", raw) == raw
        if not on:
            assert said == raw
    for kind in KINDS:
        signals.set("a", kind, 3.0, False)
    assert signals.apply("a", raw) == raw


def test_a_frozen_signal_keeps_its_first_value_and_a_biased_one_is_off_by_its_size() -> None:
    signals = SignalFaults(1)
    signals.set("a", "freeze", 0.0, True)
    assert [signals.apply("a", raw) for raw in (1.0, 2.0, 3.0)] == [1.0] * 3
    signals.set("b", "bias_step", 0.5, True)
    assert signals.apply("b", 1.0) == 1.5


@given(st.integers(1, 200), st.sampled_from(["drop", "corrupt"]), st.floats(0.1, 1.0))
def test_every_tpdo_comes_or_is_lost_and_a_disturbed_one_is_an_error_frame(n: int, kind: str, share: float) -> None:
    came: list[bytes] = []
    errors: list[int] = []
    line = FaultyLine(5, lambda cob_id, data: came.append(data), lambda: errors.append(1))
    setattr(line, kind, share)
    for number in range(n):
        line.emit(0x185, bytes([number % 256]))
        line.emit(0x705, b"\x05")  # a heartbeat is nobody's victim
    tpdos = len(came) - n
    assert came.count(b"\x05") >= n and 0 <= tpdos <= n
    assert len(errors) == (n - tpdos if kind == "corrupt" else 0)
    assert share < 1.0 or tpdos == 0
