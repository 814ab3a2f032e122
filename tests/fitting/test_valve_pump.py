"""The pump's limit, from flows and supply pressures that are drawn here; none of the product makes them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fitting.valve.model import WAYS, Structure
from fitting.valve.pump import pump_limits_of

ROWS, AREAS, HELD = 1500, (5e-3, 3e-3), 14e6
KINDS = "constant_pressure", "load_sensing"


def axes(
    rng: np.random.Generator, *, limit: float, power: float = np.inf, margin: float | None = None, late: float = 0.0
) -> list[Any]:
    """Two axes that ask for smooth flows; one pump holds 14 MPa, or a margin above the higher load.

    A pump that follows ``late`` samples late has loads that jump every 15 samples, and transducers whose zeros are off.
    """
    rows = np.arange(ROWS)

    def wave() -> np.ndarray:
        sizes, rates, phases = rng.uniform(0.2, 1.0, 4), rng.uniform(0.02, 0.1, 4), rng.uniform(0, 6, 4)
        return np.asarray(sizes @ np.sin(rates[:, None] * rows + phases[:, None]))

    asked = [wave() for _ in range(2)]
    flows = [4e-4 * own for own in asked]  # m^3/s, by the side that is filled
    loads = [4e6 + 2e6 * np.sin(rows * rng.uniform(0.01, 0.03)) for _ in range(2)]
    if late:
        loads = [np.repeat(rng.uniform(3e6, 8e6, ROWS // 15), 15) for _ in flows]
    whole = sum(np.abs(own) for own in flows)
    level = np.full(ROWS, HELD) if margin is None else np.maximum(*loads) + margin
    for k in range(1, ROWS if late else 0):
        level[k] = level[k - 1] + (level[k] - level[k - 1]) * (1.0 - np.exp(-1.0 / late))
    loads = [own + zero for own, zero in zip(loads, (2e5 * late, 0.0), strict=True)]
    supply = level - 2e8 * np.minimum(whole, 1e-3)
    most = np.minimum(limit, power / supply)
    fallen = whole > most
    supply = np.where(fallen, supply - 3e6 * (whole / most - 1.0), supply)  # orifices: less pressure, less flow
    most = np.minimum(limit, power / supply)
    given = np.minimum(1.0, most / np.maximum(whole, 1e-9))
    supply = supply + 3e4 * rng.normal(size=ROWS)
    knocks = rng.random(ROWS) < 0.03
    supply = np.where(knocks, supply - rng.uniform(0, 4e6, ROWS), supply)
    found = []
    for flow, load in zip(flows, loads, strict=True):
        speed = given * np.where(flow > 0, flow / AREAS[0], flow / AREAS[1]) * (1 + 0.01 * rng.normal(size=ROWS))
        signals = _Signals(
            first=np.zeros(ROWS, dtype=int), supply=supply, u=flow / np.abs(flow).max(), inlet=np.stack([load, load])
        )
        axis = SimpleNamespace(
            signals=signals, speed=speed, areas=AREAS, sees_supply=True, reduced=lambda c: c,
            bank=SimpleNamespace(rate_hz=50.0), drops=np.ones((2, 2)), largest=(1.0, 1.0),
        )  # fmt: skip
        gains = {f"gain.{way}": float(np.abs(flow).max()) / area for way, area in zip(WAYS, AREAS, strict=True)}
        shape = {"delay": 0.0, "edge.extend": 0.0, "edge.retract": 0.0}
        found.append(SimpleNamespace(axis=axis, shape=shape, gains=gains, structure=Structure()))
    return found


class _Signals(SimpleNamespace):
    parts = (slice(0, ROWS),)

    def __len__(self) -> int:
        return ROWS


@pytest.mark.slow
@pytest.mark.parametrize("margin", [None, 2e6])
@pytest.mark.parametrize("seed", range(3))
def test_a_flow_limit_is_found_and_no_limit_is_said_where_there_is_none(seed: int, margin: float | None) -> None:
    limits = pump_limits_of(axes(np.random.default_rng(seed), limit=6e-4, margin=margin), KINDS[margin is not None])
    found = max(limits, key=lambda own: own.odds)
    assert found.unit == "m^3/s"
    assert found.value == pytest.approx(6e-4, rel=0.03) and found.std < 0.05 * found.value
    healthy = axes(np.random.default_rng(seed), limit=np.inf, margin=margin)
    assert pump_limits_of(healthy, KINDS[margin is not None]) == ()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_load_sensing_pump_that_follows_jumping_loads_late_shows_its_limit(seed: int) -> None:
    found = pump_limits_of(axes(np.random.default_rng(seed), limit=1e-3, margin=2e6, late=2.5), KINDS[True])
    assert max(found, key=lambda own: own.odds).value == pytest.approx(1e-3, rel=0.03)
    assert pump_limits_of(axes(np.random.default_rng(seed), limit=np.inf, margin=2e6, late=2.5), KINDS[True]) == ()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.slow
def test_a_limit_of_the_power_is_told_from_one_of_the_flow(seed: int) -> None:
    (found,) = pump_limits_of(axes(np.random.default_rng(seed), limit=np.inf, power=7e3), KINDS[False])
    assert found.unit == "W" and found.value == pytest.approx(7e3, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_limit_is_found_without_the_supply_pressure_by_what_is_asked_for(seed: int) -> None:
    limited = axes(np.random.default_rng(seed), limit=6e-4)
    for fit in limited:
        fit.axis.sees_supply = False
    (found,) = pump_limits_of(limited, "unknown")
    assert found.unit == "m^3/s" and found.value == pytest.approx(6e-4, rel=0.03)


def test_nothing_is_said_where_stretches_differ() -> None:
    one, other = axes(np.random.default_rng(0), limit=6e-4)
    other.axis.signals.first = np.where(np.arange(ROWS) < 700, 0, 700)
    assert pump_limits_of([one, other], KINDS[False]) == ()
