"""The valve plant against closed forms: steady flow, oil springs, balances of volume and energy, order of the steps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from valve_rigs import EDGE, FLOW, MASS, NOMINAL, STROKE, sled_machine, sled_truth, with_cylinder, with_valve

from sim_backends.valve.lands import Lands
from sim_backends.valve.plant import ValvePlant
from sim_backends.valve.truth import Counterbalance, CylinderOil, Land, Spool, ValvePlantTruth, ValveTruth

MACHINE = sled_machine()
HEAD, ROD = MACHINE.joints[0].cylinder.head_area, MACHINE.joints[0].cylinder.rod_area  # type: ignore[union-attr]


def run(
    truths: Sequence[ValvePlantTruth], command: float, seconds: float, *, dt: float = 1e-3, at: float = 0.2
) -> ValvePlant:
    """Sleds after ``seconds`` of one command."""
    plant = ValvePlant([(sled_machine(len(truth.valves)), truth) for truth in truths], dt)
    plant.place(at)
    for _ in range(round(seconds / dt)):
        plant.step(command)
    return plant


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(stroke=st.floats(0.3, 1.0), spring=st.floats(0.0, 5000.0))
def test_a_steady_speed_is_that_of_two_orifices_in_series(stroke: float, spring: float) -> None:
    plant = run([with_cylinder(sled_truth(), spring=spring)], stroke, 0.5, at=0.05)
    state = plant.state
    # p_s A1 - p_t A2 - K x = A1 drop_in + A2 drop_out, each drop NOMINAL (flow / conductance)^2
    g = FLOW * (stroke - EDGE) / (1 - EDGE)
    force = state.supply[0] * HEAD - state.tank[0] * ROD - spring * state.x[0, 0]
    expected = np.sqrt(force / (NOMINAL * (HEAD**3 + ROD**3) / g**2))
    # The spring slows the sled while it moves: its inertia and the oil's then count for some thousandths.
    assert state.v[0, 0] == pytest.approx(expected, rel=1e-3 if spring == 0.0 else 1e-2)


@pytest.mark.slow
def test_a_compensator_keeps_the_speed_whatever_the_load_until_its_margin_is_gone() -> None:
    margin = 8.0e5
    truth = with_valve(sled_truth(pressure=6.0e6), compensation=margin, nominal_drop=margin)
    forces = (0.0, 3000.0, 6000.0, 9500.0)  # of a spring far from its rest: 9500 N ask for 48 of 60 bar
    state = run([with_cylinder(truth, spring=force / 0.25) for force in forces], 0.5, 0.3, at=0.25).state
    speeds, drops = state.v[0], state.supply - state.pressure[0, 0]
    full = FLOW * (0.5 - EDGE) / (1 - EDGE) / HEAD
    assert drops[2] > 1.9 * margin > margin > drops[3]
    # 1 / 8 of (margin / drop)^4 is missing: 0.8 % at 1.9 margins
    np.testing.assert_allclose(speeds[:3], full, rtol=0.01)
    assert speeds[3] < 0.9 * full


@pytest.mark.slow
def test_two_closed_chambers_are_a_spring_that_keeps_its_energy() -> None:
    bulk, tank, dead = 1.0e9, 5.0e5, 2.0e-4
    plant = ValvePlant([(MACHINE, sled_truth())], 1e-4)
    plant.place(0.25, 0.03)  # small enough that neither chamber falls to tank pressure
    capacity = np.array([dead + HEAD * 0.25, dead + ROD * (STROKE - 0.25)]) / bulk
    area = np.array([HEAD, -ROD])
    omega = np.sqrt((area**2 / capacity).sum() / MASS)
    start = plant.state.pressure[:, 0, 0]

    def energy() -> float:
        """Kinetic, and that of the oil: p_k = p_k0 - E ln(C_k / C_k0) as the piston moves."""
        moved = float(plant.state.x[0, 0]) - 0.25
        now = capacity + area / bulk * moved
        stored = bulk**2 * (now * np.log(now / capacity) - now + capacity).sum()
        return float(plant.kinetic_energy()[0] + stored - (area * start).sum() * moved)

    before, x = energy(), []
    for _ in range(round(2 * np.pi / omega * 20 / 1e-4)):
        plant.step(0.0)
        x.append(float(plant.state.x[0, 0]) - 0.25)
    assert energy() == pytest.approx(before, rel=1e-3)
    assert max(x) == pytest.approx(0.03 / omega, rel=5e-3)  # v0 / omega; the spring hardens by a few thousandths
    crossings = np.flatnonzero(np.diff(np.sign(x)) != 0)
    period = 2 * np.diff(crossings).mean() * 1e-4
    assert period == pytest.approx(2 * np.pi / omega, rel=2e-3)
    assert plant.state.tank[0] == tank


@pytest.mark.slow
def test_halving_the_step_quarters_the_error() -> None:
    truth = with_cylinder(sled_truth(), f_v=2000.0, spring=4000.0, piston_leak=1e-12)
    ends = []
    for dt in (2e-3, 1e-3, 5e-4, 2.5e-4):
        plant, rows = ValvePlant([(MACHINE, truth)], dt), []
        plant.place(0.2)
        for step in range(round(0.6 / dt)):
            plant.step(0.6 if step * dt < 0.3 else -0.4)
            rows.append(plant.state.x[0, 0])
        ends.append(np.array(rows)[round(0.02 / dt) - 1 :: round(0.02 / dt)])
    errors = [float(np.abs(coarse - fine).max()) for coarse, fine in pairwise(ends)]
    # Edges opening are kinks, so the order is not 2 to the digit; first order would give 2.
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0
    assert errors[1] < 1e-4  # m at the step that recordings are made with


@pytest.mark.slow
def test_oil_is_neither_made_nor_lost() -> None:
    truth = with_cylinder(sled_truth(2, flow_limit=5e-4), head_leak=2e-12, piston_gap=1e-9, head_hose=3e-13, f_c=100.0)
    plant = ValvePlant([(sled_machine(2), truth)], 2.5e-4)
    plant.place(0.2)
    rows = []
    for step in range(4000):
        plant.step([[0.7], [0.5]] if step < 2000 else [[-0.7], [-0.9]])
        state, flows = plant.state, plant.flows()
        net = flows.lands[0] - flows.lands[1] - flows.lost
        rows.append((state.x, state.pressure, state.supply, net, flows.pump - flows.lands[0].sum(axis=(0, 1))))
    x, p, supply, net, left = (np.array(column) for column in zip(*rows, strict=True))

    def integral(y: np.ndarray) -> np.ndarray:
        return np.asarray(np.trapezoid(y, dx=2.5e-4, axis=0))

    moved = np.stack([HEAD * x, -ROD * x], axis=1)
    volume = np.stack([2e-4 + HEAD * x, 2e-4 + ROD * (STROKE - x)], axis=1) / 1e9
    volume[:, 0] += 3e-13
    squeezed = (0.5 * (volume[1:] + volume[:-1]) * np.diff(p, axis=0)).sum(axis=0)
    scale = np.abs(moved - moved[0]).max()
    np.testing.assert_allclose(integral(net), moved[-1] - moved[0] + squeezed, atol=2e-3 * scale)
    stored = 2.0e-3 / 1e9 * (supply[-1] - supply[0])  # the supply's volume over its modulus
    np.testing.assert_allclose(integral(left), stored, atol=2e-3 * scale)


@pytest.mark.slow
def test_a_pump_that_gives_no_more_is_shared() -> None:
    limit = 4.0e-4
    power = 2.0e3
    limited = [sled_truth(2, flow_limit=limit, full_flow=1e-3), sled_truth(2, power_limit=power, full_flow=1e-3)]
    plant = run([with_cylinder(truth, f_v=4000.0) for truth in limited], 0.9, 0.8, at=0.05)
    flows = HEAD * plant.state.v.sum(axis=0)
    assert flows[0] == pytest.approx(limit, rel=1e-3)
    assert plant.state.supply[0] < 0.7e7  # of 100 bar
    assert plant.state.supply[1] * flows[1] == pytest.approx(power, rel=1e-3)


@pytest.mark.slow
def test_a_load_sensing_pump_stands_its_margin_above_the_load() -> None:
    truth = with_cylinder(sled_truth(kind="load_sensing", margin=2e6), f_v=2000.0)
    plant = ValvePlant([(sled_machine(upright=True), truth)])
    plant.place(0.1)
    for _ in range(800):
        plant.step(0.5)
    state = plant.state
    droop = 5.0e5 * HEAD * state.v[0, 0] / 2.0e-3  # of the pump at this flow, over its full flow
    assert state.supply[0] - state.pressure[0, 0, 0] == pytest.approx(2e6 - droop, rel=1e-3)
    assert run([truth], 0.0, 0.4).state.supply[0] == pytest.approx(2.5e6, rel=1e-3)  # standby


def test_a_command_is_late_by_its_delay_and_then_moves_a_damped_spool() -> None:
    truth = with_valve(sled_truth(), delay_retract=0.12)
    for command, delay in ((0.8, 0.05), (-0.8, 0.12)):
        plant = ValvePlant([(MACHINE, truth)])
        strokes = []
        for _ in range(300):
            plant.step(command)
            strokes.append(float(plant.state.stroke[0, 0]))
        t = np.maximum(np.arange(1, 301) * 1e-3 - delay, 0.0)
        w = 2 * np.pi * 20.0
        np.testing.assert_allclose(strokes, command * (1 - (1 + w * t) * np.exp(-w * t)), atol=1e-9)


@pytest.mark.slow
def test_a_piston_comes_to_rest_at_the_end_of_its_stroke() -> None:
    plant = run([with_cylinder(sled_truth(), f_v=500.0, f_c=200.0)], 1.0, 2.0)
    assert STROKE < plant.state.x[0, 0] < STROKE + 1e-3
    assert abs(plant.state.v[0, 0]) < 1e-3  # a few bounces of the oil are left
    assert plant.state.pressure[0, 0, 0] == pytest.approx(1e7, rel=1e-3)


@pytest.mark.slow
def test_a_counterbalance_valve_holds_and_lowers_a_load_that_would_run_ahead() -> None:
    upright = sled_machine(upright=True)
    held = Counterbalance("head", setting=4e6, ratio=3.0, span=1e7, flow=FLOW)
    free = with_valve(with_cylinder(sled_truth(mass=600.0), f_v=2000.0), clearance=2e-12)
    braked = with_cylinder(free, counterbalance=held)
    plant = ValvePlant([(upright, truth) for truth in (free, braked)])
    plant.place(0.4)
    for _ in range(1000):
        plant.step(0.0)
    sunk = 0.4 - plant.state.x[0]
    assert sunk[0] > 1e-3 > 1e-5 > sunk[1]
    compensated = [with_valve(t, compensation=1e6, clearance=0.0) for t in (free, braked)]
    plant = ValvePlant([(upright, truth) for truth in compensated])
    plant.place(0.5)
    for _ in range(600):
        plant.step(-0.4)
    before = plant.state.x[0]
    for _ in range(400):
        plant.step(-0.4)
    speed = (plant.state.x[0] - before) / 0.4
    let_in = FLOW * 0.3 / 0.9 / ROD  # m/s of the oil that the compensator lets in
    assert speed[0] < -1.1 * let_in  # the load runs ahead, oil is made up from tank
    assert plant.state.pressure[1, 0, 0] < plant.state.tank[0]
    assert speed[1] == pytest.approx(-let_in, rel=0.02)
    assert plant.state.pressure[1, 0, 1] > plant.state.tank[1] + 2e5


def _one(valve: ValveTruth, oil: CylinderOil | None = None) -> Lands:
    return Lands([[valve]], [[oil or CylinderOil(1e-4, 1e-4)]])


@settings(deadline=None)
@given(
    edge=st.floats(0.0, 0.3),
    exponent=st.floats(1.0, 2.0),
    saturation=st.one_of(st.just(np.inf), st.floats(0.3, 1.2)),
    compensation=st.one_of(st.just(np.inf), st.floats(3e5, 3e6)),
    softness=st.floats(0.0, 0.5),
    line=st.one_of(st.just(np.inf), st.floats(1e-4, 1e-2)),
    stroke=st.floats(-1.0, 1.0),
    drop=st.floats(-3e7, 3e7),
)
def test_every_edge_gives_energy_away(edge: float, exponent: float, saturation: float, compensation: float,
                                      softness: float, line: float, stroke: float, drop: float) -> None:  # fmt: skip
    land = Land(edge, FLOW, exponent, saturation)
    names = ("head_in", "rod_in", "head_out", "rod_out")
    valve = ValveTruth(Spool(0.0, 0.0), dict.fromkeys(names, land), NOMINAL, compensation, softness, load_check=False)
    lands = _one(valve, CylinderOil(1e-4, 1e-4, line_in=line, line_out=line))
    one = np.ones((2, 2, 1, 1))

    def flow(stroke: float, drop: float) -> tuple[np.ndarray, np.ndarray]:
        g = lands.conductance(np.array([[stroke]]), np.ones(1))
        return lands.flow(g, drop * one, one[0])

    q, slope = flow(stroke, drop)
    assert np.all(q * drop >= 0.0)
    assert np.all(slope >= 0.0)
    assert np.all(q[0] * q[1] == 0.0)  # a chamber is never filled and emptied at once
    wider = flow(np.clip(1.1 * stroke, -1.0, 1.0), drop)[0]
    assert np.all(np.abs(wider) >= np.abs(q) * (1 - 1e-12))
    step = max(abs(drop), 1e4) * 1e-4
    numeric = (flow(stroke, drop + step)[0] - flow(stroke, drop - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope, numeric, rtol=1e-3, atol=1e-3 * np.abs(q).max() / max(abs(drop), 1e4) + 1e-20)
