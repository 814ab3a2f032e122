"""``hilfit bench long``: recordings laid end to end, and how a report is judged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks.speed import FRICTION, PAYLOAD, _moment, _named, joined, picked_up
from sim_backends.plant.cases import plan_case


def _report(*effects: dict[str, Any]) -> dict[str, Any]:
    overall = {"before": 1.5, "after": 1.0, "change_percent": -33.3, "role": "validate"}
    return {"overall": overall, "loop": {"effects": list(effects), "unexplained": []}}


def _effect(id: str, joint: str | None, *rivals: str, moment: float = 0.0) -> dict[str, Any]:
    others = [{"id": rival, "joint": joint} for rival in rivals]
    return {"id": id, "joint": joint, "indistinguishable_from": others, "parameters": {"t_0": {"value": moment}}}


def test_tables_laid_end_to_end_run_on_one_clock() -> None:
    first: dict[str, Any] = {"time": np.arange(4) * 0.02, "a": np.arange(4.0)}
    second: dict[str, Any] = {"time": np.arange(3) * 0.02, "a": np.arange(10.0, 13.0)}
    whole = joined([first, second])
    assert np.allclose(whole["time"], np.arange(7) * 0.02)
    assert whole["a"].tolist() == [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0]


@pytest.mark.parametrize(
    ("effects", "met"),
    [
        ([_effect(FRICTION.id, "joint2")], [True, True]),
        ([_effect("end_cushion", "joint2", FRICTION.id)], [True, True]),
        ([_effect(FRICTION.id, "joint1")], [False, False]),
        ([_effect(FRICTION.id, "joint2"), _effect("stribeck", "joint4")], [True, False]),
        ([], [False, True]),
    ],
)
def test_an_effect_counts_where_it_is_named_or_in_the_set(effects: list[dict[str, Any]], met: list[bool]) -> None:
    checks = _named(_report(*effects), "ten minutes", FRICTION)
    assert [check.met for check in checks] == [*met, True]


def test_the_moment_is_judged_from_the_true_one() -> None:
    right = _report(_effect(PAYLOAD.id, None, moment=4230.0))
    assert _moment(right, 4200.0).met and not _moment(right, 3000.0).met and not _moment(_report(), 4200.0).met


@pytest.mark.slow
def test_the_payload_is_there_from_its_moment_on() -> None:
    plan = plan_case("slewing", 3)
    table = picked_up(plan, 2.0)
    assert len(table["time"]) == 120 * 50 and np.allclose(np.diff(table["time"]), 0.02)
    for channel in (c.name for c in plan.machine.channels if "position" in c.quantity):
        steps = np.abs(np.diff(table[channel]))
        assert steps[3499] < 5 * np.quantile(steps, 0.99), channel  # no jump at the seam
