"""Undeclared effects of valves: each form does to a small machine what its physics says, and is seen in recordings."""

from __future__ import annotations

import numpy as np
import pytest
from valve_rigs import EDGE, FLOW, sled_machine, sled_truth, with_cylinder, with_valve

from daq.errors import InputError
from sim_backends.valve.effects import VALVE_EFFECTS, ValveEffectSpec, valve_obstacle, with_effect
from sim_backends.valve.plant import ValvePlant
from sim_backends.valve.spools import Spools
from sim_backends.valve.truth import Counterbalance, Spool, ValvePlantTruth

MACHINE = sled_machine()
HEAD, ROD = MACHINE.joints[0].cylinder.head_area, MACHINE.joints[0].cylinder.rod_area  # type: ignore[union-attr]


def with_one(effect: str, form: str, size: float, truth: ValvePlantTruth | None = None) -> ValvePlantTruth:
    joint = None if VALVE_EFFECTS[effect, form].whole else "slide1"
    return with_effect(MACHINE, truth or sled_truth(), ValveEffectSpec(effect, form, joint, size))


def strokes(truth: ValvePlantTruth, commands: list[float], warmth: float = 1.0, each: float = 0.4) -> np.ndarray:
    """Strokes at the end of each command, held for ``each`` s."""
    spools = Spools([[truth.valves["slide1"].spool]], 1e-3)
    ends = []
    for command in commands:
        for _ in range(round(each * 1000)):
            spools.step(np.array([[command]]), np.array([warmth]))
        ends.append(float(spools.stroke[0, 0]))
    return np.array(ends)


def test_a_play_is_twice_its_half_width_between_up_and_down() -> None:
    up_and_down = [0.2, 0.4, 0.6, 0.8, 0.6, 0.4, 0.2]
    told = strokes(with_one("spool_hysteresis", "play", 0.03), up_and_down)
    np.testing.assert_allclose(told[:3] - told[:3:-1], -0.06, atol=1e-3)


def test_a_solenoids_loop_is_narrower_for_small_swings() -> None:
    truth = with_one("spool_hysteresis", "magnetic", 0.04)
    ramp = list(np.linspace(0.0, 1.0, 26))
    wide = strokes(truth, [*ramp, *ramp[::-1]], each=0.1)
    half = 0.5 * (wide[26:][::-1] - wide[:26])
    assert half.max() == pytest.approx(0.04, rel=0.1)
    small = strokes(truth, [0.5, 0.52, 0.54, 0.52, 0.5, 0.52, 0.54, 0.52], each=0.2)
    assert 0.0 < 0.5 * (small[7] - small[5]) < 0.5 * half.max()


@pytest.mark.slow
def test_a_spool_that_sticks_ignores_small_changes_and_then_goes_all_the_way() -> None:
    told = strokes(with_one("spool_stick", "dry", 0.03), [0.3, 0.32, 0.31, 0.335, 0.33])
    np.testing.assert_allclose(told, [0.3, 0.3, 0.3, 0.335, 0.335], atol=2e-3)
    silted = with_one("spool_stick", "silt", 0.03)
    np.testing.assert_allclose(strokes(silted, [0.3, 0.31], each=0.3)[1], 0.31, atol=2e-3)  # at once it does not stick
    assert strokes(silted, [0.3, 0.3, 0.32], each=3.0)[2] == pytest.approx(0.3, abs=2e-3)


def test_a_delay_differs_by_direction_as_dead_time_or_as_lag() -> None:
    def late(truth: ValvePlantTruth, sign: float) -> float:
        """First moment of the step response: delay and lag together."""
        spools = Spools([[truth.valves["slide1"].spool]], 1e-3)
        area = 0.0
        for _ in range(2000):
            spools.step(np.array([[0.5 * sign]]), np.ones(1))
            area += (1.0 - float(spools.stroke[0, 0]) / (0.5 * sign)) * 1e-3
        return area

    healthy = 0.05 + 2.0 / (2 * np.pi * 20.0)  # delay and 2 damping / w of the rig's spool
    for form in ("dead_time", "pilot"):
        truth = with_one("delay_per_direction", form, 0.1)
        assert late(truth, 1.0) == pytest.approx(healthy, abs=2e-3)
        assert late(truth, -1.0) == pytest.approx(healthy + 0.1, abs=2e-3)


def test_warmth_takes_stroke_from_a_coil_and_gives_flow_to_the_oil() -> None:
    coil = with_one("warm_up", "coil", 0.1)
    assert strokes(coil, [0.5], warmth=0.0)[0] == pytest.approx(0.5, abs=1e-3)
    assert strokes(coil, [0.5], warmth=1.0)[0] == pytest.approx(0.45, abs=1e-3)
    plant = ValvePlant([(MACHINE, with_one("warm_up", "viscosity", 0.2))] * 2, power_on=[0.0, 1e5])
    plant.place(0.1)
    for _ in range(500):
        plant.step(0.6)
    cold, warm = plant.state.v[0]
    assert cold / warm == pytest.approx(0.8, rel=5e-3)  # the edges' laminar beginning differs a little


def sinking(*truths: ValvePlantTruth) -> list[tuple[float, float, float]]:
    """Loads of 400 kg on closed valves for 4 s: mean speed, and how the pressures of head and rod changed, of each."""
    plant = ValvePlant([(sled_machine(upright=True), with_cylinder(truth, f_v=5000.0)) for truth in truths])
    plant.place(0.4)
    before = plant.state.pressure[:, 0]
    for _ in range(4000):
        plant.step(0.0)
    changed = plant.state.pressure[:, 0] - before
    speeds = (plant.state.x[0] - 0.4) / 4.0
    return list(zip(speeds.tolist(), *changed.tolist(), strict=True))


@pytest.mark.slow
def test_a_rest_tells_a_leak_past_the_piston_from_one_at_a_port() -> None:
    heavy = sled_truth(mass=400.0)
    tank = heavy.supply.tank
    held = (400.0 * 9.81 + tank * ROD) / HEAD  # Pa in the head chamber once the rod's is at tank
    tight, seal, head_port, rod_port = sinking(
        heavy,
        with_one("piston_leak", "seal", 0.02, heavy),
        with_one("port_leak", "head_port", 0.02, heavy),
        with_one("port_leak", "rod_port", 0.05, heavy),
    )
    assert abs(tight[0]) < 1e-6
    # Past the piston: the rod chamber takes less than the head gives, so the oil of both is squeezed.
    speed, head, rod = seal
    assert head > 1e5 < rod
    assert speed < 0.0
    # From the head port to tank: v = leak / A1 at the pressure of the load; rod falls to tank, where oil is made up.
    leak = 0.02 * FLOW / 1e7
    speed, _, rod = head_port
    assert speed == pytest.approx(-leak * (held - tank) / HEAD, rel=0.1)
    assert rod < -4e5
    # From the rod port: the rod chamber empties, the load does not sink by more than the oil relaxes.
    speed, _, rod = rod_port
    assert rod < -1e5
    assert abs(speed) < 1e-4


@pytest.mark.slow
def test_without_its_compensator_a_valve_feels_the_load() -> None:
    margin = 8e5
    healthy = with_valve(sled_truth(pressure=1.2e7), compensation=margin, nominal_drop=margin)

    def speeds(truth: ValvePlantTruth) -> np.ndarray:
        loads = [with_cylinder(truth, spring=k, f_v=3000.0) for k in (0.0, 4.0e4)]
        plant = ValvePlant([(MACHINE, load) for load in loads])
        plant.place(0.25)
        for _ in range(500):
            plant.step(0.8)
        return np.asarray(plant.state.v[0])

    free, loaded = speeds(healthy)
    assert loaded == pytest.approx(free, rel=0.01)
    for form, size in (("no_compensator", 5e6), ("soft_compensator", 0.6), ("line_throttle", 15.0)):
        free, loaded = speeds(with_one("undeclared_orifice", form, size, healthy))
        assert loaded < 0.93 * free


def test_a_worn_edge_opens_earlier_or_lets_oil_through_before() -> None:
    shifted = with_one("edge_wear", "shifted", 0.03)
    assert {land.edge for land in shifted.valves["slide1"].lands.values()} == {EDGE - 0.03}
    plant = ValvePlant([(MACHINE, truth) for truth in (sled_truth(), shifted, with_one("edge_wear", "rounded", 0.02))])
    plant.place(0.1)
    for _ in range(400):
        plant.step(EDGE - 0.01)
    healthy, earlier, rounded = plant.state.v[0]
    assert abs(healthy) < 1e-6
    assert earlier > 1e-3 < rounded


def test_what_an_earlier_calibration_tells() -> None:
    assert strokes(with_one("null_shift", "spring", 0.02), [0.5])[0] == pytest.approx(0.52, abs=1e-3)
    assert with_one("slower_spool", "pilot", 0.3).valves["slide1"].spool.frequency == pytest.approx(6.0)
    assert with_one("air_in_oil", "foam", 0.2).oil.bulk_modulus == pytest.approx(2e8)


@pytest.mark.parametrize(("key", "size"), [(key, effect.large[1]) for key, effect in VALVE_EFFECTS.items()])
def test_every_form_changes_the_truth_and_survives_a_file(key: tuple[str, str], size: float) -> None:
    effect = VALVE_EFFECTS[key]
    truth = sled_truth()
    if effect.compensated:
        truth = with_valve(truth, compensation=1e6)
    if effect.held:
        truth = with_cylinder(truth, counterbalance=Counterbalance("head", 4e6, 3.0, 2e6, FLOW))
    changed = with_one(*key, size, truth)
    assert changed != truth
    assert ValvePlantTruth.from_dict(changed.to_dict()) == changed


def test_an_effect_that_cannot_be_there_is_refused() -> None:
    def refused(*spec: object) -> str:
        with pytest.raises(InputError) as told:
            with_effect(MACHINE, sled_truth(), ValveEffectSpec(*spec))  # type: ignore[arg-type]
        return str(told.value)

    assert "forms seal, scored_bore" in refused("piston_leak", "hole", "slide1", 0.1)
    assert "there are effects" in refused("rust", "red", "slide1", 0.1)
    assert "has no joint 'boom'; one of slide1" in refused("piston_leak", "seal", "boom", 0.1)
    assert "no pressure-compensated valve" in refused("undeclared_orifice", "soft_compensator", "slide1", 0.5)
    assert "no counterbalance valve" in refused("overrunning_load", "no_counterbalance", "slide1", 2.0)
    assert "leave the joint out" in refused("pump_flow_limit", "flow", "slide1", 0.5)
    assert "finite" in refused("piston_leak", "seal", "slide1", float("nan"))
    assert valve_obstacle(VALVE_EFFECTS["piston_leak", "seal"], MACHINE, sled_truth(), "slide1") is None


def test_a_healthy_spool_has_no_memory() -> None:
    spool = Spool(0.01, 0.01, frequency=30.0)
    assert (spool.play, spool.magnetic, spool.stick, spool.null) == (0.0, 0.0, 0.0, 0.0)
    told = strokes(sled_truth(), [0.2, 0.6, 0.2])
    assert told[0] == pytest.approx(told[2], abs=1e-6)


@pytest.mark.slow
def test_a_restless_pilot_stage_wanders_as_much_as_it_says() -> None:
    spool = Spool(0.0, 0.0, frequency=50.0, damping=1.0, restless=0.01, restless_time=0.1)

    def wandering(rngs: list[np.random.Generator] | None) -> np.ndarray:
        spools = Spools([[spool] * 2] * 3, 1e-3, rngs)
        rows = []
        for _ in range(20_000):
            spools.step(np.full((2, 3), 0.5), np.ones(3))
            rows.append(spools.stroke)
        return np.array(rows)[200:]

    stroke = wandering([np.random.default_rng(p) for p in (1, 2, 1)])
    # 200 correlation times: the variance is right to some 10 %; the spool follows all but the fastest of it.
    assert stroke.std(axis=0).mean() == pytest.approx(0.01, rel=0.15)
    np.testing.assert_array_equal(stroke[:, :, 0], stroke[:, :, 2])
    assert abs(np.corrcoef(stroke[:, 0, 0], stroke[:, 1, 0])[0, 1]) < 0.3
    assert wandering(None).std() < 1e-9
