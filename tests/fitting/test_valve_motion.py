"""Planned valve motions: what they visit, what they keep, and the program that plays them, played."""

from __future__ import annotations

import json
import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_valve_export import model
from valve_bench import machine_of

from benchmarks.exports.structured_text import Library
from daq import InputError
from daq.machine.machine_file import Machine
from fitting.valve.motion import CLEAR, LEVEL, Planned, plan_valve_motions, written_plan
from sim_backends.valve.machines import default_crane
from sim_backends.valve.valve_process import read_valve_motion

CRANE, _ = default_crane()
PERIOD = 0.02


@pytest.fixture(scope="module")
def plans() -> list[Planned]:
    """Of the crane."""
    return plan_valve_motions(CRANE)


def report(**change: Any) -> dict[str, Any]:
    """A valve report of the crane's boom alone."""
    return {"schema": "hilfit/valve/1", "axes": {"boom": {"model": model("boom", **change).to_json()}}}


def test_each_axis_has_a_motion_and_all_together_one_within_the_limits(plans: list[Planned]) -> None:
    assert [own.name for own in plans] == ["valve-boom", "valve-jib", "valve-all"]
    for own in plans:
        assert {use.quantity for use in own.limits} == {"position", "velocity", "acceleration", "stroke"}
        assert all(use.used <= 1.0 for use in own.limits)
        assert max(use.used for use in own.limits if use.quantity == "velocity") > 0.6, "levels are as large as allowed"
    assert [own.name for own in plan_valve_motions(CRANE, ["jib"])] == ["valve-jib"]


def shares(planned: Planned, axis: int, does: str) -> list[float]:
    own = planned.motion.axes[axis]
    return [own.share(step.values[axis]) for step in planned.motion.steps if step.does == does]


def test_an_axis_is_held_at_levels_of_both_signs_at_two_loads_walks_its_edges_and_swings(plans: list[Planned]) -> None:
    planned = plans[0]
    assert max(map(abs, shares(planned, 1, "hold"))) == 0.0, "the other axis keeps its valve closed"
    held = [step.seconds for step in planned.motion.steps if step.does == "hold"]
    level_seconds = 3.0 * 0.25 + 0.4
    levels = [
        planned.motion.axes[0].share(step.values[0])
        for step in planned.motion.steps
        if step.does == "hold" and step.seconds == pytest.approx(level_seconds)
    ]
    assert len(levels) == 2 * 2 * 6 and max(held) == 10.0
    assert sorted(levels) == pytest.approx(sorted(-own for own in levels)), "each is undone by its opposite"
    assert 0.6 <= max(levels) <= LEVEL
    rungs = {round(own, 3) for own in shares(planned, 0, "hold")}
    assert {sign * number / 100 for sign in (1, -1) for number in range(1, 17)} <= rungs
    assert len(shares(planned, 0, "swing")) == 3
    poses = {step.values[1] for step in planned.motion.steps if step.does == "go"}
    assert len(poses) == 2, "the other axis stands elsewhere for another load"


def test_an_earlier_report_moves_the_ladders_and_bounds_the_levels() -> None:
    slow, fast = (plan_valve_motions(CRANE, ["boom"], report(gain=gain))[0] for gain in (0.2, 0.6))
    assert fast.motion.axes[0].most < slow.motion.axes[0].most
    assert fast.motion.axes[0].speed == pytest.approx(3.0 * slow.motion.axes[0].speed)
    assert max(use.used for use in fast.limits) <= 1.0
    up = {round(own, 3) for own in shares(slow, 0, "hold")}
    # The report's edges are .06 of extend, which raises the boom, and .12 of retract: in the middle of the ladders.
    ladders = {round(sign * (edge + step / 100), 3) for sign, edge in ((1, 0.06), (-1, 0.12)) for step in range(-5, 6)}
    assert ladders <= up and not {-0.06, 0.12} & up


@pytest.mark.parametrize(
    ("joints", "known", "says"),
    [
        (["slew"], None, "joint 'slew': valve-crane has boom, jib"),
        (None, {"schema": "hilfit/report/1"}, "--after: is no valve report"),
        (None, report(gain=20.0), "boom: a command of .* hardly moves it"),
    ],
)
def test_what_cannot_be_planned_is_one_line(joints: list[str] | None, known: Any, says: str) -> None:
    with pytest.raises(InputError, match=rf"^{says}"):
        plan_valve_motions(CRANE, joints, known)


def test_a_machine_without_valves_is_refused() -> None:
    content = CRANE.model_dump(mode="json")
    assert content["joints"]
    joints = tuple(
        own.model_copy(update={"cylinder": own.cylinder and own.cylinder.model_copy(update={"valve": None})})
        for own in CRANE.joints
    )
    with pytest.raises(InputError, match=r"no joint has a cylinder\.valve"):
        plan_valve_motions(CRANE.model_copy(update={"joints": joints}))


class Controller:
    """The program in an interpreter, before axes that are straight beyond a dead band, and late by ``delay`` s."""

    def __init__(self, planned: Planned, folder: Path, faster: float, edge: float, delay: float) -> None:
        _, program = written_plan(planned, folder)
        self.axes = planned.motion.axes
        self.block = Library(program.read_text(encoding="utf-8")).block(planned.name.replace("-", "_"))
        self.q = [0.5 * (own.low + own.high) for own in self.axes]
        self.faster, self.edge = faster, edge
        self.late = deque([[0.0] * len(self.axes)] * (round(delay / PERIOD) + 1), round(delay / PERIOD) + 1)

    def cycle(self, *, run: bool = True, position: list[float] | None = None) -> tuple[dict[str, Any], list[float]]:
        """What it says, and the shares of full that it sends."""
        said = self.block(run=run, dt_s=PERIOD, position=position or list(self.q))
        share = [own.share(value) for own, value in zip(self.axes, said["command"], strict=True)]
        self.late.append(share)
        for k, (own, u) in enumerate(zip(self.axes, self.late[0], strict=True)):
            opened = max(abs(u) - self.edge, 0.0) / (1.0 - own.edge)
            self.q[k] += math.copysign(self.faster * own.speed * opened, u) * PERIOD
        return said, share


@pytest.mark.slow
@pytest.mark.parametrize(("machine", "faster"), [(CRANE, 1.3), (CRANE, 0.7), (machine_of(), 1.3)])
def test_the_program_plays_the_table_within_travel_and_rate(tmp_path: Path, machine: Machine, faster: float) -> None:
    planned = plan_valve_motions(machine)[0]
    controller = Controller(planned, tmp_path, faster, edge=0.06, delay=0.2)
    axes, positions, sent = planned.motion.axes, [], []
    for _ in range(round(3.0 * planned.seconds / PERIOD)):
        said, share = controller.cycle()
        positions.append(list(controller.q))
        sent.append(share)
        if said["done"]:
            break
    assert said["done"] and not said["fault"]
    assert 0.4 * planned.seconds < len(sent) * PERIOD < 2.0 * planned.seconds
    q, u = np.array(positions), np.array(sent)
    for k, own in enumerate(axes):
        assert q[:, k].min() > own.low and q[:, k].max() < own.high
        assert np.abs(u[:, k]).max() <= own.most + 1e-9
        rising = np.diff(np.abs(u[:, k]), prepend=0.0)
        assert rising.max() <= own.rate * PERIOD + 1e-9
    table = read_valve_motion(tmp_path / "valve-boom.csv", machine)
    held = {round(axes[0].share(step.values[0]), 4) for step in table.steps if step.does == "hold"}
    played = {round(own, 4) for own in u[:, 0].tolist()}
    assert held <= played, "every level of the table was sent"
    assert [controller.cycle()[1] for _ in range(3)] == [[0.0] * len(axes)] * 3, "and then the valves are closed"


def test_released_it_closes_the_valves_at_once_and_begins_anew(tmp_path: Path) -> None:
    planned = plan_valve_motions(machine_of())[0]
    controller = Controller(planned, tmp_path, 1.0, edge=0.08, delay=0.1)
    while controller.cycle()[0]["place"] < 5:
        pass
    said, share = controller.cycle(run=False)
    assert share == [0.0] and said["place"] == 0 and not said["fault"]
    assert controller.cycle()[0]["place"] == 0


@pytest.mark.parametrize("position", [math.nan, math.inf, 1e9])
def test_a_position_that_cannot_be_closes_the_valves_until_it_is_released(tmp_path: Path, position: float) -> None:
    planned = plan_valve_motions(machine_of())[0]
    controller = Controller(planned, tmp_path, 1.0, edge=0.08, delay=0.1)
    while controller.cycle()[1] == [0.0]:
        pass
    said, share = controller.cycle(position=[position])
    assert said["fault"] and share == [0.0]
    said, share = controller.cycle()
    assert said["fault"] and share == [0.0], "a good value alone does not start it again"
    assert not controller.cycle(run=False)[0]["fault"]
    while controller.cycle()[1] == [0.0]:
        pass


def test_the_program_says_what_the_controller_owes_the_machine(tmp_path: Path) -> None:
    _, program = written_plan(plan_valve_motions(machine_of())[0], tmp_path)
    text = program.read_text(encoding="utf-8")
    assert "watchdog" in text and "dead-man" in text and "25 %" in text and f"{100 * CLEAR} %" in text


def test_the_command_writes_tables_and_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from daq.machine.machine_file import machine_to_yaml
    from server.commands.command_line import main

    (tmp_path / "crane.yaml").write_text(machine_to_yaml(CRANE), encoding="utf-8")
    with pytest.raises(SystemExit) as caught:
        main(["valve-motion", str(tmp_path / "crane.yaml"), "-o", str(tmp_path / "out"), "--level", "0.4", "--json"])
    assert not caught.value.code
    said = json.loads(capsys.readouterr().out)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        f"valve-{name}.{kind}" for name in ("all", "boom", "jib") for kind in ("csv", "st")
    ]
    for own in said["motions"]:
        motion = read_valve_motion(own["file"], CRANE)
        assert all(axis.most <= 0.4 for axis in motion.axes)
    assert "begin with a small --level" in said["notes"][-1]
