"""The monitor of valves: the fit's own numbers on live rows, quiet while a valve is healthy, and what moved."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq import Machine, read_recording
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.frame import row_dtype
from daq.machine.machine_file import machine_to_yaml
from fitting.valve.drift import STATISTICS, Block, Kept, block_of, moved_numbers
from fitting.valve.fit import Fit, fitted
from fitting.valve.model import Structure
from fitting.valve.rows import axis_of
from server.identifications.live_model import NotLiveError
from server.monitor.followed import Speeds
from server.monitor.monitor_child import run, watch
from server.monitor.monitor_order import Order, Rules
from server.monitor.monitor_supervisor import WORDS, Monitors, _Watch, changed
from server.monitor.residual_blocks import Windows
from tests.fitting.valve_bench import Bench, machine_of, written

RULES = Rules(learn=40)
BENCH = Bench()
STRUCTURE = Structure(laws=("meter_in", "meter_in"), stiffness=True)
Said = list[dict[str, Any]]


@pytest.fixture(scope="module")
def machine() -> Machine:
    return machine_of()


@pytest.fixture(scope="module")
def fit(machine: Machine, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    folder = tmp_path_factory.mktemp("bench")
    recordings = [read_recording(written(folder, machine, BENCH, seed), machine, "operation") for seed in (1, 2, 3)]
    return fitted(axis_of(machine, machine.joints[0], recordings), STRUCTURE)


@pytest.fixture(scope="module")
def report(fit: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of an identification what the monitor reads."""
    file = tmp_path_factory.mktemp("report") / "valve.json"
    axis = {"fit": Kept.of(fit).to_json(), "errors": {"handed_out": fit.misfit}}
    file.write_text(json.dumps({"axes": {"boom": axis}}), encoding="utf-8")
    return file


def rows(machine: Machine, bench: Bench, seeds: range) -> list[np.ndarray[Any, Any]]:
    """What a ring buffer has of some motions."""
    names, found = [channel.name for channel in machine.channels], []
    for seed in seeds:
        table = bench.run(seed, 100.0)
        found.append(np.zeros(len(table["time"]), dtype=row_dtype(len(names))))
        found[-1]["time"], found[-1]["values"] = table["time"], np.column_stack([table[name] for name in names])
    return found


def watched(machine: Machine, report: Path, memory: Path, several: list[np.ndarray[Any, Any]]) -> Said:
    followed = Speeds(report, machine, RULES)
    cutter = Windows(followed.overlap, followed.block_samples(RULES.block_s))
    order = Order("valves", report, Path("m"), "ring", memory, RULES)
    said: Said = []
    windows = (window for one in several for window in cutter.push(one, missed=1))
    names = tuple(channel.name for channel in machine.channels)
    watch(followed, names, order, windows, lambda found: said.append(json.loads(json.dumps(found))))
    return said


@pytest.fixture(scope="module")
def healthy(machine: Machine, report: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Said, Path]:
    memory = tmp_path_factory.mktemp("memory") / "memory.json"
    return watched(machine, report, memory, rows(machine, BENCH, range(50, 55))), memory


def test_what_is_kept_of_a_fit_is_asked_again(fit: Fit) -> None:
    content = json.loads(json.dumps(Kept.of(fit).to_json()))
    assert json.loads(json.dumps(Kept.from_json(content).to_json())) == content


def test_a_block_leaves_what_the_fit_leaves_there(machine: Machine, fit: Fit, tmp_path: Path) -> None:
    """Numbers of a window are those of the whole recording: same filters, same model, same rows."""
    recording = read_recording(written(tmp_path, machine, BENCH, 9), machine, "operation")
    axis = axis_of(machine, machine.joints[0], [recording], like=fit.axis)
    whole = fit.on(axis)[0]
    kept, bank = Kept.of(fit), axis.bank
    start, samples = 20 * bank.decimation, 100 - 100 % bank.decimation
    stop = start + 1000 - 1000 % bank.decimation
    block = block_of(machine, "boom", kept, recording.cut(slice(start, stop)), samples)
    assert block is not None
    here = axis_of(machine, machine.joints[0], [recording.cut(slice(start, stop))], like=fit.axis)
    last = start // bank.decimation + len(here.speed)
    own = slice(last - samples // bank.decimation, last)
    moving = np.abs(axis.speed[own]) > 2e-3
    e = whole.residual[own]
    assert block.residual == pytest.approx(float(np.sqrt(np.mean(e[moving] ** 2))), rel=0.05)
    assert set(block.statistics or ()) <= set(STATISTICS)


def test_a_gap_is_no_block(machine: Machine, fit: Fit, tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path, machine, BENCH, 9), machine, "operation").cut(slice(0, 800))
    assert block_of(machine, "boom", Kept.of(fit), recording, 100) is not None
    command = recording.values["u"].copy()
    command[400] = np.nan
    torn = replace(recording, values={**recording.values, "u": command})
    assert block_of(machine, "boom", Kept.of(fit), torn, 100) is None


def test_numbers_that_moved_are_found_with_their_intervals() -> None:
    """From sums over blocks alone: what nobody moved is not named, and few blocks name nothing."""
    rng, true = np.random.default_rng(3), np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.03])
    blocks, errors = list[Block](), list[float]()
    for _ in range(60):
        W = rng.normal(size=(40, 6)) * [0.3, 0.1, 0.2, 0.3, 0.1, 0.2]
        W[:, 0] += W[:, 1]  # edges and gains look alike
        e = W @ true + 2e-3 * rng.normal(size=40)
        blocks.append(Block(float("nan"), W.T @ W, W.T @ e))
    moved = {own.name: own for own in moved_numbers(blocks, np.zeros(6), np.zeros(6))}
    assert {"edge.extend", "delay.retract"} <= set(moved)
    for name, value in (("edge.extend", 0.02), ("delay.retract", 0.03)):
        errors.append((moved[name].value - value) / moved[name].std)
    assert np.max(np.abs(errors)) < 3.0
    assert moved_numbers(blocks[:10], np.zeros(6), np.zeros(6)) == []
    sizes = np.sqrt([np.diag(own.normal) for own in blocks])
    usual = np.mean([own.score for own in blocks] / sizes, axis=0)
    assert moved_numbers(blocks, usual, np.zeros(6)) == [], "a model that was always off by that has moved nowhere"


@pytest.mark.slow
def test_a_healthy_valve_is_watched_in_silence(healthy: tuple[Said, Path]) -> None:
    said, memory = healthy
    assert [own["state"] for own in (said[0], said[-1])] == ["learning", "watching"]
    assert not any(own["drifting"] for own in said)
    assert len(said) > 200
    assert said[-1]["joints"][0]["unit"] == "m/s" and "moved" not in said[-1]["joints"][0]
    assert json.loads(memory.read_text("utf-8"))["drifting"] == []


CHANGES: dict[str, tuple[Mapping[str, Any], dict[str, float]]] = {
    "wear": ({"edges": (0.045, 0.12)}, {"edge.extend": -0.015}),
    "late": ({"delay": 0.2}, {"delay.extend": 0.04, "delay.retract": 0.04}),
    "weak": ({"gains": (0.30, 0.315)}, {"gain.retract": -0.1}),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", CHANGES)
def test_a_change_raises_a_drift_that_says_what_moved(
    machine: Machine, report: Path, healthy: tuple[Said, Path], tmp_path: Path, what: str
) -> None:
    change, true = CHANGES[what]
    memory = tmp_path / "memory.json"
    memory.write_bytes(healthy[1].read_bytes())
    said = watched(machine, report, memory, rows(machine, replace(BENCH, **change), range(60, 62)))
    first = next(number for number, own in enumerate(said) if own["drifting"])
    assert first < 25, "within a minute of motion"
    joint = said[-1]["joints"][0]
    moved = {own["name"]: own for own in joint["moved"]}
    for name, value in true.items():
        assert moved[name]["value"] == pytest.approx(value, rel=0.15)
    assert next(iter(moved)) in true, "the surest first"
    words = changed("valves", joint)
    assert words[0].startswith(f"the {next(iter(moved)).split('.')[0]} of ")
    assert changed("valves", joint | {"moved": []}) == [f"{WORDS[joint['statistic']]} seems to have moved"]


def test_the_process_follows_valves_until_the_ring_ends(machine: Machine, report: Path, tmp_path: Path) -> None:
    file = tmp_path / "machine.yaml"
    file.write_text(machine_to_yaml(machine), encoding="utf-8")
    said: list[Any] = []
    with ring_buffer(row_dtype(len(machine.channels)), 64) as name, RingWriter(name) as writer:
        writer.finish()
        run(Order("valves", report, file, name, tmp_path / "m.json", RULES), said.append)
    assert [found["state"] for found in said] == ["learning"]
    assert said[0]["delay_s"] > 0.0


def test_what_cannot_be_followed_says_what_to_do(machine: Machine, report: Path, tmp_path: Path) -> None:
    with pytest.raises(NotLiveError, match="identify again"):
        Speeds(tmp_path / "valve.json", machine, RULES)
    (tmp_path / "old.json").write_text('{"axes": {"boom": {}}}')
    with pytest.raises(NotLiveError, match="identify again"):
        Speeds(tmp_path / "old.json", machine, RULES)
    with pytest.raises(NotLiveError, match="no command of boom any more"):
        Speeds(report, machine_of("x head rod ps pt"), RULES)
    blind = machine_of("x u")
    table = rows(blind, BENCH, range(50, 51))
    with pytest.raises(NotLiveError, match=r"boom: pressures .* no longer measured; identify with the present"):
        watched(blind, report, tmp_path / "m.json", table)
    content = json.loads(report.read_text("utf-8"))
    content["axes"]["boom"]["fit"]["structure"]["effects"] = ["warm_up"]
    (tmp_path / "warm.json").write_text(json.dumps(content))
    with pytest.raises(NotLiveError, match="channel oil_temperature"):
        Speeds(tmp_path / "warm.json", machine, RULES)


def test_a_drift_of_valves_is_an_alarm_of_its_own_and_orders_no_recalibration(tmp_path: Path) -> None:
    reported: list[tuple[Any, ...]] = []
    asked: list[str] = []
    alarms: Any = SimpleNamespace(report=lambda *given: reported.append(given))
    none: Any = None
    files: Any = SimpleNamespace(root=tmp_path)
    monitors = Monitors(
        none, none, none, files, none, alarms, lambda: "now", recalibrate=lambda machine, text: asked.append(machine)
    )
    moved = {"name": "edge.extend", "value": -0.0208, "std": 0.0005, "unit": "of full command"}
    joint = {"joint": "boom", "statistic": "edge.extend", "moved": [moved]}
    other = {"joint": "jib", "statistic": "delay.retract"}
    found = {"state": "drift", "drifting": ["boom"], "joints": [joint, other]}
    monitors._received("crane", _Watch("cal-2", "ring", "valves"), found)
    (alarm,) = reported
    assert (alarm[0], alarm[1], alarm[3:]) == ("crane", "valve_drift", ("warning", True))
    assert alarm[2] == (
        "speeds drift from what the valves gave: boom: the edge of extending has moved by -0.0208 of full command "
        "(standard deviation 0.0005); look at the valve and its amplifier, or identify it again"
    )
    assert asked == []
