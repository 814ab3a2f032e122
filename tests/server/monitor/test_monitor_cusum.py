"""The monitor's decisions: the stated false-alarm rate holds, changes are found, and what was learnt is not trusted."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.monitor import cusum
from server.monitor.cusum import Sums
from server.monitor.drift_watcher import YEAR_S, Usual, Watcher, threshold
from server.monitor.monitor_order import Rules


def simulated_run_length(threshold: float, allowance: float, shift: float, chains: int, seed: int) -> float:
    """Mean run length of two-sided sums on normal numbers, by simulation of many chains side by side."""
    random = np.random.default_rng(seed)
    up, down = np.zeros(chains), np.zeros(chains)
    lengths = np.zeros(chains)
    running = np.ones(chains, dtype=bool)
    while running.any():
        z = random.standard_normal(chains) + shift
        up, down = np.maximum(0, up + z - allowance), np.maximum(0, down - z - allowance)
        lengths += running
        running &= np.maximum(up, down) < threshold
    return float(lengths.mean())


@pytest.mark.slow
@pytest.mark.parametrize(("threshold", "allowance"), [(3.0, 0.5), (4.0, 0.5), (5.0, 0.5), (3.0, 0.75)])
def test_siegmunds_formula_against_simulation(threshold: float, allowance: float) -> None:
    simulated = simulated_run_length(threshold, allowance, 0.0, 4000, 1)
    # 4000 exponential run lengths have a mean good to 1.6 %; the formula itself to a few per cent.
    assert cusum.run_length(threshold, allowance) == pytest.approx(simulated, rel=0.08)


def test_siegmunds_formula_against_the_published_table() -> None:
    """Montgomery, Introduction to Statistical Quality Control, table 9.3: two-sided, k = 1/2, h = 4 and 5."""
    assert cusum.run_length(4.0) == pytest.approx(168, rel=0.02)
    assert cusum.run_length(5.0) == pytest.approx(465, rel=0.02)


@given(st.floats(10, 1e12), st.floats(0.2, 1.0))
def test_the_threshold_is_the_inverse(numbers: float, allowance: float) -> None:
    if numbers >= cusum.run_length(0.0, allowance):
        assert cusum.run_length(cusum.threshold_for(numbers, allowance), allowance) == pytest.approx(numbers, rel=1e-6)


def test_a_rate_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="threshold of zero"):
        cusum.threshold_for(1.0)


@given(st.lists(st.floats(-50, 50), max_size=100), st.floats(1, 20))
def test_sums_never_leave_their_range_and_a_wild_number_is_no_drift(values: list[float], threshold: float) -> None:
    sums = Sums()
    for z in values:
        after = cusum.step(sums, z, threshold)
        assert 0 <= after.up <= 2 * threshold
        assert 0 <= after.down <= 2 * threshold
        assert after.up - sums.up <= cusum.CLIP - cusum.ALLOWANCE + 1e-9
        sums = after


def run(values: np.ndarray, rules: Rules) -> list[str]:
    watcher = Watcher.begin(("joint1",), ("offset",), rules)
    states = []
    for value in values:
        watcher = watcher.step({"joint1": {"offset": float(value)}})
        states.append(watcher.state)
    return states


def coloured(count: int, correlation: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    series = np.empty(count)
    last = random.standard_normal()
    for k in range(count):
        series[k] = last
        last = correlation * last + math.sqrt(1 - correlation**2) * random.standard_normal()
    return 3.0 + 2.0 * series


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_false_alarms_stay_below_the_stated_rate_with_a_learnt_baseline(correlation: float) -> None:
    """Thirty machines that never change; mean, colour and size of each are estimated from 120 numbers."""
    rules = Rules(learn=120, block_s=2.0, false_alarms_per_year=YEAR_S / 2.0 / 2000)  # one in 2000 numbers
    alarms, numbers = 0, 0
    for seed in range(30):
        states = run(coloured(1120, correlation, seed), rules)
        alarms += sum(a != "drift" and b == "drift" for a, b in itertools.pairwise(states))
        numbers += 1000
    # At the stated rate 15 would be expected; 27 is three standard deviations more.
    assert alarms <= 27
    assert numbers / 2000 == 15


@pytest.mark.parametrize("shift", [2.0, 4.0])
def test_a_change_is_found_soon_and_forgotten_when_it_goes(shift: float) -> None:
    values = coloured(700, 0.0, 3)
    values[300:400] += 2.0 * shift
    states = run(values, Rules())
    assert set(states[:119]) == {"learning"}
    assert set(states[120:300]) == {"watching"}
    found = states[300:400].index("drift")
    # A sum that gains (shift - allowance) standard deviations per number, both widened by what 120 numbers leave open.
    assert found <= 2.0 * threshold(Rules(), 1) / (0.85 * shift - 0.7)
    assert states[-1] == "watching"


def test_more_statistics_share_the_same_number_of_false_alarms() -> None:
    rules = Rules(false_alarms_per_year=2.0)
    for statistics in (1, 3, 18):
        rate = YEAR_S / rules.block_s * statistics / cusum.run_length(threshold(rules, statistics))
        assert rate == pytest.approx(2.0)


def test_a_joint_reports_the_false_alarm_rate_of_its_own_statistics() -> None:
    watcher = Watcher.begin(("a", "b"), ("offset", "direction"), Rules(learn=5))
    for k in range(6):
        watcher = watcher.step({"a": {"offset": float(k % 2), "direction": float(k % 3)}, "b": None})
    said = watcher.joint("a"), watcher.joint("b")
    assert said[0]["false_alarms_per_year"] == pytest.approx(0.5)
    assert said[1]["false_alarms_per_year"] == 0.0
    assert (said[0]["learnt"], said[1]["learnt"]) == (1.0, 0.0)


@pytest.mark.parametrize("blocks", [4, 10, 13, 60])
def test_what_was_learnt_and_the_sums_are_kept_over_a_restart(blocks: int) -> None:
    def watcher_after(values: np.ndarray, watcher: Watcher) -> Watcher:
        for value in values:
            watcher = watcher.step({"a": {"offset": float(value)}})
        return watcher

    fresh = Watcher.begin(("a",), ("offset",), Rules(learn=10))
    chance = np.random.default_rng(1)
    # A drift of six standard deviations after what is learnt from: little is learnt, so much is allowed.
    values = np.concatenate([chance.standard_normal(10), 6.0 + chance.standard_normal(50)])[:blocks]
    before = watcher_after(values, fresh)
    again = fresh.remembering(json.loads(json.dumps(before.memory())))
    assert again.memory() == before.memory()
    assert (again.state, again.drifting) == (before.state, before.drifting)
    assert again.joint("a") == before.joint("a"), "the sums stand where they stood"
    assert (blocks == 60) == (again.state == "drift")
    assert again.step({"a": None}).memory() == before.step({"a": None}).memory()


def test_a_memory_of_other_joints_is_ignored() -> None:
    known = Watcher.begin(("a",), ("offset",), Rules(learn=10)).step({"a": {"offset": 1.0}})
    other = Watcher.begin(("b",), ("offset",), Rules(learn=10))
    assert other.remembering(known.memory()) == other
    with pytest.raises(KeyError):
        other.remembering({"a/offset": {}})


def test_the_learnt_deviation_is_not_too_small() -> None:
    values = tuple(coloured(120, 0.5, 2))
    usual = Usual.of(values)
    assert usual.correlation == pytest.approx(0.5, abs=0.2)
    innovations = 2.0 * math.sqrt(1 - 0.25)
    assert innovations < usual.std < 1.5 * innovations
    assert usual.allowance > cusum.ALLOWANCE


def test_a_joint_that_rests_changes_nothing() -> None:
    watcher = Watcher.begin(("a",), ("offset",), Rules(learn=10))
    for value in np.random.default_rng(1).standard_normal(30):
        watcher = watcher.step({"a": {"offset": float(value)}})
    rested = watcher.step({"a": None}).step({})
    assert rested.joint("a") == watcher.joint("a")


@pytest.mark.parametrize(("shift", "slack", "drifts"), [(3.0, 0.0, True), (3.0, 3.0, False), (8.0, 3.0, True)])
def test_what_a_model_may_be_off_by_is_no_drift(shift: float, slack: float, drifts: bool) -> None:
    """In standard deviations; what is beyond counts, however wild a number may be at most."""
    rng = np.random.default_rng(5)
    watcher = Watcher.begin(("j",), ("s",), Rules(learn=40))
    for value in rng.normal(size=60):
        watcher = watcher.step({"j": {"s": float(value)}})
    assert watcher.state == "watching"
    for value in rng.normal(size=400) + shift:
        watcher = watcher.step({"j": {"s": float(value)}}, {"j": {"s": slack}})
    assert bool(watcher.drifting) == drifts
