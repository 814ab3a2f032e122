"""Overloads live: what a recording shows, found in the ring's rows as they come, and said as an alarm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from live_lever import RATE, handed_over, recording, session, signals

from daq.frames.frame import row_dtype
from fitting.model.arm_model import ArmModel
from fitting.model.uses.overload import overloads, thresholds
from server.identifications.live_model import LiveModel, NotLiveError
from server.monitor.monitor_child import OverloadWatch
from server.monitor.monitor_order import OverloadNow
from server.monitor.monitor_supervisor import Monitors, _Watch

NAMES = ("joint1.angle", "joint1.torque")
HIT, LASTS, SIZE = 12.0, 0.4, 30.0


@pytest.fixture(scope="module")
def model() -> ArmModel:
    return handed_over(session())


def hit_rows(seconds: float = 20.0, seed: int = 5) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    t, values = signals(seconds, seed)
    struck = SIZE * ((t >= HIT) & (t < HIT + LASTS))
    values["joint1.torque"] = values["joint1.torque"] + struck
    table = np.zeros(len(t), dtype=row_dtype(2))
    table["time"], table["cycle"] = t, np.arange(len(t))
    table["values"] = np.column_stack([values[name] for name in NAMES])
    return table, values


@pytest.mark.slow
@pytest.mark.parametrize("at_once", [1, 7])
def test_a_hit_is_found_within_a_tenth_of_a_second_and_ends(model: ArmModel, at_once: int) -> None:
    table, values = hit_rows()
    watch = OverloadWatch(LiveModel(model), NAMES, 1.0)
    table = table[round(10 * RATE) :]
    said: list[OverloadNow] = []
    for start in range(0, len(table), at_once):
        said += watch.push(table[start : start + at_once])
    assert [hit.on for hit in said] == [True, False]
    wait = (at_once - 1) / RATE  # rows that came together are judged together
    assert HIT < said[0].time <= HIT + 0.1 + wait + 1e-9
    assert said[1].time >= HIT + LASTS + 0.5
    assert (said[0].joint, said[0].unit) == ("joint1", "N m")
    assert said[0].residual == pytest.approx(SIZE, rel=0.3)
    nearest = {joint.joint: joint for joint in watch.nearest()}
    assert nearest["joint1"].share > 1.0 and nearest["joint1"].residual == pytest.approx(SIZE, rel=0.3)
    assert all(joint.share < 1.0 for name, joint in nearest.items() if name != "joint1")
    assert watch.nearest() == []  # nothing came since
    assert model.tails is not None
    whole = replace(recording(20, 5, "operation"), values=values)
    (offline,) = overloads(model, whole, thresholds(model.tails, 1.0))
    assert offline.found == pytest.approx(said[0].time, abs=1.5 / RATE + wait)


def test_a_gap_or_lost_rows_say_nothing(model: ArmModel) -> None:
    table, _ = hit_rows()
    watch = OverloadWatch(LiveModel(model), NAMES, 1.0)
    table["quality"][round((HIT + 0.1) * RATE), 1] = 1
    assert watch.push(table[: round((HIT + 0.2) * RATE)]) == []
    watch = OverloadWatch(LiveModel(model), NAMES, 1.0)
    assert watch.push(table[: round(HIT * RATE)]) == []
    assert watch.push(table[-20:], missed=3) == []


def test_a_model_that_does_not_say_what_is_usual_is_refused(model: ArmModel) -> None:
    with pytest.raises(NotLiveError, match="usual"):
        OverloadWatch(LiveModel(replace(model, tails=None)), NAMES, 1.0)


def test_an_overload_is_an_alarm_while_it_lasts(tmp_path: Path) -> None:
    reported: list[tuple[Any, ...]] = []
    alarms: Any = SimpleNamespace(report=lambda *given: reported.append(given))
    none: Any = None
    files: Any = SimpleNamespace(root=tmp_path)
    monitors = Monitors(none, none, none, files, none, alarms, lambda: "now")
    watch = _Watch("cal-1", "ring")
    begun = {"on": True, "time": 3.0, "joint": "boom", "residual": 812.0, "unit": "N m", "score": 9.1, "threshold": 6.0}
    near = [{"joint": "boom", "residual": 700.0, "unit": "N m", "share": 1.2}]
    monitors._received("arm", watch, {"overload_joints": near})
    assert watch.found["overload_joints"] == near
    monitors._received("arm", watch, {"overload": begun})
    monitors._received("arm", watch, {"overload": {**begun, "on": False}})
    assert [(kind, severity, on) for _, kind, _, severity, on in reported] == [
        ("overload", "critical", True),
        ("overload", "critical", False),
    ]
    assert "boom" in reported[0][2] and "+812 N m" in reported[0][2]
    assert watch.found["overload"] is None
