"""Valves: what a bench with known edges, gains, delays and effects is identified as (`valve_bench.py`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal, stats
from valve_bench import RATE, STROKE, TANK, Bench, machine_of, written

from daq import InputError, Machine, Recording, read_recording
from fitting.regression.freedom import freedom_of, moved_without
from fitting.residual.confirmation.local import Local, beside, elsewhere
from fitting.selection.evidence import with_curve
from fitting.signals.filters import PARTS, delayed, filter_bank, followed
from fitting.signals.splines import DEGREE, evaluate, free_curve, spline_knots
from fitting.valve.checks import compensated_edge
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import fitted, predicted, relative
from fitting.valve.identify import Identified, identify_valves
from fitting.valve.inverse import CLIPPED, NO_NUMBER, NO_PRESSURE, REST_SHARE, Direction, ValveModel
from fitting.valve.laws import LAWS, laws_for
from fitting.valve.model import Structure, columns, solved
from fitting.valve.rows import Signals, axis_of

Identify = Callable[..., Identified]
TRAIN, VALIDATE, SECONDS = (1, 2, 3), 9, 35.0
#: What each effect of the bench is, large enough to be seen and small enough to be there on a machine.
CASES: dict[str, dict[str, Any]] = {
    "spool_hysteresis": {"hysteresis": 0.02},
    "delay_per_direction": {"later": 0.1},
    "warm_up": {"cold": -0.25},
    "piston_leak": {"leak": 8e-13},
}


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> Identify:
    """Identifications of benches, each made when first asked for."""
    made: dict[Any, Identified] = {}

    def of(machine: Machine | None = None, *, loop: bool = True, **bench: Any) -> Identified:
        described = machine or machine_of()
        key = (repr(described), loop, tuple(sorted(bench.items())))
        if key not in made:
            own, folder = Bench(**bench), tmp_path_factory.mktemp("bench")
            recordings = [
                read_recording(written(folder, described, own, seed, SECONDS), described, "operation")
                for seed in (*TRAIN, VALIDATE)
            ]
            made[key] = identify_valves(described, recordings[:-1], recordings[-1:], loop=loop)
        return made[key]

    return of


def within(found: dict[str, Any], true: float, *, sigmas: float, slack: float) -> bool:
    """Whether an estimate is as near to the truth as it says; ``slack`` is what the bench's own steps are worth."""
    return abs(found["value"] - true) <= sigmas * found["std"] + slack


# --- what a sound valve is identified as --------------------------------------------------------------------------


@pytest.mark.slow
def test_edges_gains_delay_and_law_of_an_orifice_valve_are_found(identified: Identify) -> None:
    bench, axis = Bench(), identified().report["axes"]["boom"]
    # 20 steps a cycle: a delay is a multiple of 1 ms, and edges are crossed at 2e-4 of full a step.
    assert within(axis["delay"], bench.delay, sigmas=4, slack=1e-3)
    for way, own in enumerate(axis["directions"].values()):
        assert within(own["edge"], bench.edges[way], sigmas=4, slack=2e-4)
        assert own["law"]["id"] == "meter_in"
        at_reference = bench.gains[way] * np.sqrt(own["reference_drop"]["inlet"] / 1e7)
        assert own["gain"]["value"] == pytest.approx(at_reference, rel=0.01)
    assert axis["effects"] == [] and axis["verdict"] == "nothing_missing" and axis["checks"] == []
    # 1.2e9 Pa with hoses of 2e-4 m^3: told apart from the stroke's own oil only roughly.
    assert axis["stiffness"]["bulk_modulus"]["value"] == pytest.approx(1.2e9, rel=0.3)


@pytest.mark.slow
def test_the_band_of_the_curve_holds_the_bench_and_is_made_of_edge_and_gain(identified: Identify) -> None:
    bench, axis = Bench(), identified().report["axes"]["boom"]
    curve = axis["figures"]["curve"]
    for u, v, std in zip(curve["command"], curve["speed"], curve["std"], strict=True):
        way = 0 if u > 0 else 1
        own = list(axis["directions"].values())[way]
        edge, gain = own["edge"], own["gain"]
        beyond = abs(u) - edge["value"]
        if beyond <= 0:
            assert v == 0.0
            continue
        true = bench.speed(way, abs(u), bench.supply - own["reference_drop"]["inlet"])
        # A hundredth of the gain is what the test above allows for the bench's own steps.
        assert abs(abs(v) - true) <= 4 * std + 0.01 * true + 2e-4 * gain["value"]
        # Whatever the two have in common, the band of k (u - e) lies between difference and sum of both shares.
        shares = beyond * gain["std"], gain["value"] * edge["std"]
        assert abs(shares[0] - shares[1]) * 0.98 <= std <= sum(shares) * 1.02


def wanted(seed: int, seconds: float = 120.0) -> np.ndarray:
    """Speeds of an axis that follows a motion, share of full."""
    rng, time = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE
    sines = zip(rng.uniform(0.05, 0.2, 4), rng.uniform(0.05, 0.3, 4), rng.uniform(0, 6.28, 4), strict=True)
    return np.sum([a * np.sin(2 * np.pi * f * time + p) for a, f, p in sines], axis=0)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("edge", [0.037, 0.105])
def test_the_dead_band_that_a_controller_compensates_is_read_out_of_its_commands(seed: int, edge: float) -> None:
    v = wanted(seed)
    sent = np.where(np.abs(v) > 0.004, np.sign(v) * edge + v, 0.0)  # it rests below
    nothing = np.zeros(len(v), dtype=np.int64)
    for side in (sent, -sent):
        found = compensated_edge(side, nothing)
        assert found is not None and edge <= found <= edge + 0.02, "the least it sent is a step of its cycle beyond"


def test_nobody_is_said_to_compensate_who_sends_small_commands_or_levels() -> None:
    assert compensated_edge(np.zeros(10), np.zeros(10, dtype=np.int64)) is None
    for seed in range(20):
        v = wanted(seed)
        assert compensated_edge(v, np.zeros(len(v), dtype=np.int64)) is None
    levels = np.repeat([0.0, 0.1, 0.0, -0.1, 0.0, 0.25, 0.0, 0.4, 0.0, 0.6], 100)
    assert compensated_edge(levels, np.zeros(len(levels), dtype=np.int64)) is None


@pytest.mark.slow
def test_the_delay_is_where_the_whole_models_misfit_is_least(identified: Identify) -> None:
    profile = np.array(identified().report["axes"]["boom"]["delay"]["profile"])
    assert abs(profile[np.argmin(profile[:, 1]), 0] - Bench().delay) <= 0.05  # the profile's own step
    assert np.all(np.diff(profile[profile[:, 0] >= 0.2, 1]) > 0)


@pytest.mark.slow
def test_on_another_motion_no_peer_is_as_good(identified: Identify) -> None:
    errors = identified().report["axes"]["boom"]["errors"]
    assert errors["role"] == "validate"
    assert errors["handed_out"] < 0.01 < 0.05 < errors["static"] < errors["linear"]
    assert errors["arx"] > 0.05


@pytest.mark.slow
def test_a_compensated_valve_needs_no_law_of_the_pressure(identified: Identify) -> None:
    axis = identified(laws=("none", "none")).report["axes"]["boom"]
    for own in axis["directions"].values():
        value = own.get("exponent", {"value": 0.0})["value"]
        assert own["law"]["id"] in ("none", "compensated") or abs(value) < 0.02
    assert axis["effects"] == [] and axis["errors"]["after"] < 0.01


@pytest.mark.slow
def test_an_orifice_where_the_file_says_compensated_is_named(identified: Identify) -> None:
    found = identified(machine_of(compensated=True))
    axis = found.report["axes"]["boom"]
    assert [own["id"] for own in axis["effects"]] == ["undeclared_orifice"]
    assert axis["errors"]["after"] < 0.3 * axis["errors"]["before"]
    assert found.models["boom"].directions[0].law == "meter_in"  # the inverse knows of it


@pytest.mark.slow
@pytest.mark.parametrize("effect", CASES)
def test_an_effect_is_named_and_the_error_on_another_motion_falls(identified: Identify, effect: str) -> None:
    axis = identified(**CASES[effect]).report["axes"]["boom"]
    first = axis["effects"][0]
    assert effect in (first["id"], *first["indistinguishable_from"])
    assert first["probability"] > 0.5 and axis["verdict"] in ("effect_added", "ambiguous")
    assert axis["errors"]["after"] < 0.75 * axis["errors"]["before"] and axis["errors"]["after"] < 0.01


@pytest.mark.slow
def test_the_motion_that_is_judged_on_refuses_and_does_not_choose(identified: Identify) -> None:
    """Two more motions to judge by, one of them of a valve without the effect: it alone changes what is said."""
    bench, machine = Bench(**CASES["delay_per_direction"]), machine_of()
    fitted_ones = [recording(bench, seed, SECONDS) for seed in TRAIN]

    def found(judged: Recording) -> dict[str, Any]:
        other = replace(judged, sha256="1")
        axis: dict[str, Any] = identify_valves(machine, fitted_ones, [other]).report["axes"]["boom"]
        return axis

    one, other = identified(**CASES["delay_per_direction"]).report["axes"]["boom"], found(recording(bench, 10, SECONDS))
    assert [own["id"] for own in one["effects"]] == [own["id"] for own in other["effects"]] == ["delay_per_direction"]
    assert one["effects"][0]["parameters"] == other["effects"][0]["parameters"]
    assert one["handed_out"] == "model"
    refused = found(recording(Bench(), VALIDATE, SECONDS))
    assert refused["effects"] == refused["unexplained"] == [] and refused["handed_out"] == "before"
    tried = {own["id"]: own for own in refused["candidates"][0]}["delay_per_direction"]
    assert "does not help on the validation motion" in tried["reason"] and tried["probability"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variable", "unknown"), [("piston_position", {"bent": 0.3}), ("neighbours_flow", {"taken": 400.0})]
)
def test_what_no_name_says_is_a_law_of_its_variable(identified: Identify, variable: str, unknown: Any) -> None:
    axis = identified(machine_of("x u head rod ps pt y f"), **unknown).report["axes"]["boom"]
    assert axis["effects"] == [] and axis["verdict"] == "unexplained"
    (law,) = axis["unexplained"]
    assert law["variable"] == variable and law["indistinguishable_from"] == [] and law["probability"] > 0.95
    assert law["error_after"] < 0.6 * law["error_before"]
    grid, value, std = (np.array(law["law"][key]) for key in ("grid", "value", "std"))
    true = 0.3 * (grid / STROKE - 0.5) if variable == "piston_position" else -400.0 * grid
    off = value - true - np.mean(value - true)  # a gain for all is the base's
    assert np.all(np.abs(off) < 4.0 * std + 0.05), "to first order, and in the middle of what was visited"


@pytest.mark.slow
def test_sizes_of_effects_are_those_of_the_bench(identified: Identify) -> None:
    def sizes(effect: str) -> dict[str, Any]:
        report = identified(**CASES[effect]).report["axes"]["boom"]
        own: dict[str, Any] = report["effects"][0]["parameters"]
        return own

    assert sizes("spool_hysteresis")["width"]["value"] == pytest.approx(0.02, abs=5e-4)
    assert sizes("delay_per_direction")["half"]["value"] == pytest.approx(-0.05, abs=2e-3)
    assert sizes("warm_up")["share"]["value"] == pytest.approx(-0.25, abs=0.02)


@pytest.mark.slow
def test_a_pump_that_gives_no_more_is_seen_without_its_pressure_and_handed_to_the_inverse(identified: Identify) -> None:
    """The bench's pump holds its pressure whatever is taken: only what is asked for tells of the limit."""
    found = identified(machine_of("x u head rod pt"), pump=6e-4)
    limit = found.report["axes"]["boom"]["pump_limit"]
    assert limit["value"] == pytest.approx(6e-4, rel=0.05) and limit["ci95"][0] < 6e-4 < limit["ci95"][1]
    assert found.models["boom"].pump_limit == limit["value"]


@pytest.mark.slow
def test_a_curve_is_earned_where_the_land_is_no_line(identified: Identify) -> None:
    own = identified(power=1.4).report["axes"]["boom"]["directions"]["extend"]
    assert own["curve"] == "power" and own["power"]["value"] == pytest.approx(1.4, abs=0.03)
    assert identified().report["axes"]["boom"]["directions"]["extend"]["curve"] == "line"


# --- what less is measured costs ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_chamber_pressures_curve_and_delay_are_told_and_the_rest_is_said(identified: Identify) -> None:
    axis = identified(machine_of("x u")).report["axes"]["boom"]
    assert {check["code"] for check in axis["checks"]} == {"no_pressures"}
    assert {own["law"]["id"] for own in axis["directions"].values()} == {"none"} and axis["stiffness"] is None
    assert axis["delay"]["value"] == pytest.approx(Bench().delay, abs=0.02)
    assert axis["errors"]["handed_out"] <= axis["errors"]["static"]


@pytest.mark.slow
def test_without_a_supply_pressure_no_law_of_the_inlet_is_tried(identified: Identify) -> None:
    axis = identified(machine_of("x u head rod")).report["axes"]["boom"]
    assert "no_supply" in {check["code"] for check in axis["checks"]}
    assert set(axis["laws"]["extend"]) == {"none", "meter_out"}
    assert axis["errors"]["handed_out"] <= axis["errors"]["static"]


def recording(
    bench: Bench, seed: int = 1, seconds: float = 30.0, machine: Machine | None = None, **change: Any
) -> Recording:
    """A recording in memory, with some channels changed."""
    own = machine or machine_of()
    table = {**bench.run(seed, seconds)}
    table.update({name: how(table[name]) for name, how in change.items()})
    values = {channel.name: table[channel.name] for channel in own.channels}
    return Recording("bench", "operation", "run.parquet", "0", RATE, table["time"], values)


@pytest.mark.slow
def test_mistakes_in_the_command_are_said_with_their_cure() -> None:
    def codes(**change: Any) -> set[str]:
        report = identify_valves(machine_of(), [recording(Bench(), **change)], [], loop=False).report
        return {check["code"] for check in report["axes"]["boom"]["checks"]}

    assert codes() == set()
    assert "command_sign" in codes(u=lambda u: -u)
    assert "command_axis" in codes(u=lambda u: np.random.default_rng(1).permutation(u))
    taken_off = codes(u=lambda u: np.sign(u) * np.maximum(np.abs(u) - np.where(u > 0, 0.06, 0.12), 0.0))
    assert "before_compensation" in taken_off
    assert "unvisited" in codes(u=lambda u: 0.5 * u)
    assert "one_way" in codes(u=lambda u: np.maximum(u, 0.0))


def test_what_cannot_be_identified_is_one_line() -> None:
    machine = machine_of()
    still = recording(Bench(), u=lambda u: 0.0 * u)
    with pytest.raises(InputError, match=r"^run\.parquet: boom: no axis is moved by its command; record a motion"):
        identify_valves(machine, [still], [])
    with pytest.raises(InputError, match="no recording; give at least one"):
        identify_valves(machine, [], [])
    with pytest.raises(InputError, match="no channel of quantity command; add one"):
        identify_valves(machine_of("x head rod"), [still], [])
    with pytest.raises(InputError, match=r"bandwidth 30 Hz must be at least .* and at most 10 Hz"):
        identify_valves(machine, [still], [], bandwidth_hz=30.0)
    short = still.cut(slice(0, 100))
    with pytest.raises(InputError, match=r"no stretch of .* without a gap; record again"):
        identify_valves(machine, [short], [])


# --- parts --------------------------------------------------------------------------------------------------------


def test_a_dead_band_is_moved_by_filtering_the_command_first_and_not_by_filtering_afterwards() -> None:
    """Why command and speed pass one filter behind the non-linearity: the analytic case of a slow sine."""
    t = np.arange(3000) / RATE
    u, edge = 0.3 * np.sin(2 * np.pi * 1.5 * t), 0.1
    bank = filter_bank(RATE, 3.0)
    speed = bank.reduce(np.sign(u) * np.maximum(np.abs(u) - edge, 0.0))
    early = bank.reduce(u)
    assert np.allclose(speed, bank.reduce(np.sign(u) * np.maximum(np.abs(u) - edge, 0.0)))
    assert np.max(np.abs(speed - np.sign(early) * np.maximum(np.abs(early) - edge, 0.0))) > 0.02


@given(st.floats(0.0, 20.0), st.integers(0, 400))
def test_a_held_command_is_as_late_as_its_integral_says(samples: float, seed: int) -> None:
    """Oracle: the area below a step is the time that is left after it."""
    count, at = 100, 10 + seed % 40
    u = np.where(np.arange(count) >= at, 1.0, 0.0)
    late = delayed([slice(0, count)], u, samples)
    # The step is held from its sample's own moment on; sums over rows stand for integrals from -1/2 to count - 1/2.
    assert float(np.sum(late)) == pytest.approx(count - 0.5 - (at + samples), abs=1e-9)


@settings(max_examples=8)
@given(st.floats(0.5, 6.0), st.floats(0.4, 1.5))
def test_a_spool_follows_as_a_mass_on_a_spring_does(samples: float, damping: float) -> None:
    """Oracle: the step's answer of the differential equation, the mean over a part of a cycle at a time."""
    u = np.where(np.arange(120) >= 10, 1.0, 0.0)
    own = followed([slice(0, len(u))], u, samples, damping)
    w, fine = 2.0 * damping / samples, np.arange(0.0, 100.0, 0.005) + 0.0025
    answer = signal.lti([w * w], [1.0, 2 * damping * w, w * w]).step(T=fine)[1]
    assert np.allclose(own[:, 10:110].T, answer.reshape(100, PARTS, -1).mean(axis=2), atol=5e-3)
    assert np.all(own[:, :10] == 0.0)
    assert float(np.sum(u - own.mean(axis=0))) == pytest.approx(samples, abs=0.01)  # late on the average


@pytest.mark.parametrize(("curve", "power"), [("line", 1.0), ("power", 0.7), ("power", 1.4)])
def test_a_short_pulse_moves_the_rod_by_the_integral_of_the_lands_opening(curve: str, power: float) -> None:
    """Oracle: the differential equation of a spool that crosses its edge within a cycle, in ten thousandths of one."""
    edge, samples, jump, cycles = 0.3, 0.9, 0.8, 3
    count = 1000
    u = np.where((np.arange(count) >= 500) & (np.arange(count) < 500 + cycles), jump, 0.0)
    machine = machine_of("x u")
    whole = recording(Bench(), machine=machine, u=lambda own: np.append(u, np.zeros(len(own) - count)))
    axis = axis_of(machine, machine.joints[0], [whole])
    shape = {"delay": 0.1, "lag": samples / RATE, "damping": 1.0, "edge.extend": edge, "edge.retract": edge}
    names, matrix = columns(axis, Structure(curve=curve), shape | {"power.extend": power, "power.retract": power})
    moved = float(np.sum(matrix[:, names.index("gain.extend")])) * axis.bank.decimation
    w, t = 2.0 / samples, (np.arange(200_000) + 0.5) / 1e4
    step = 1.0 - (1.0 + w * t) * np.exp(-w * t)
    stroke = jump * (step - np.append(np.zeros(cycles * 10_000), step[: -cycles * 10_000]))
    assert moved == pytest.approx(float(np.sum(np.maximum(stroke - edge, 0.0) ** power)) / 1e4, rel=0.01)


def test_each_direction_has_a_delay_and_a_lag_of_its_own() -> None:
    """Extending as a valve that is later and slower in both, retracting as one that is earlier and faster."""
    machine = machine_of("x u")
    axis = axis_of(machine, machine.joints[0], [recording(Bench(), machine=machine)])
    shape = {"delay": 0.12, "lag": 0.05, "damping": 0.8, "edge.extend": 0.06, "edge.retract": 0.12}
    own = {"delay_per_direction.half": 0.03, "delay_per_direction.lag": 0.02}
    names, both = columns(axis, Structure(effects=("delay_per_direction",)), shape | own)
    for name, sign in (("gain.extend", 1.0), ("gain.retract", -1.0)):
        moved = shape | {"delay": 0.12 + sign * 0.03, "lag": 0.05 + sign * 0.02}
        np.testing.assert_allclose(
            both[:, names.index(name)], columns(axis, Structure(), moved)[1][:, names.index(name)]
        )


def test_a_spool_without_a_lag_is_where_it_is_told_to_be() -> None:
    u = np.random.default_rng(3).normal(size=80)
    assert np.allclose(followed([slice(0, len(u))], u, 0.0, 1.0), u, atol=2e-2)


@given(st.floats(0.5, 2.5), st.lists(st.floats(0.0, 2.0), min_size=DEGREE + 1, max_size=DEGREE + 1))
def test_a_free_curve_never_falls_holds_every_power_and_goes_on_as_it_ends(power: float, gains: list[float]) -> None:
    opening = np.linspace(0.0, 0.9, 181)
    parts = free_curve(opening, power, 0.6)
    curve = np.array(gains) @ np.array(parts)
    assert curve[0] == 0.0 and np.all(np.diff(curve) >= -1e-12)
    whole = (opening / 0.6) ** power
    assert np.allclose(np.sum(parts, axis=0), whole)  # equal gains: the power itself
    slopes = np.diff(curve) / np.diff(whole)
    assert np.allclose(slopes[whole[:-1] >= 1.0], gains[-1])


@pytest.mark.parametrize("order", [1.0, 4.0, 12.0])
def test_a_compensator_takes_over_softly(order: float) -> None:
    """An orifice far below its margin, none of the pressure far above it, never more than either, and no corner."""
    margin, reference = 8e5, np.array([1e6, 1.0])
    drop = np.linspace(0.0, 2e7, 4001)
    law, shape = LAWS["compensated"], {"margin": margin, "order": order}
    factor = law.factor(drop / reference[0], drop, reference, shape) / law.factor(
        np.full(1, 1e9), drop, reference, shape
    )
    assert np.all(factor <= np.minimum(1.0, np.sqrt(drop / margin)) + 1e-9) and np.all(np.diff(factor) >= 0.0)
    assert factor[-1] == pytest.approx(1.0, abs=0.03)
    assert factor[2] == pytest.approx(np.sqrt(drop[2] / margin), rel=0.02)
    bends = np.diff(factor, 2)[20:]
    assert np.all(bends <= 1e-9) and np.abs(bends).max() < 0.1 * np.diff(factor)[20:].max()


def test_a_leak_of_one_port_is_told_apart_from_one_of_the_other() -> None:
    """What a balance of each chamber loses to the tank, with nothing lost at the other port."""
    one, rng = np.ones(60), np.random.default_rng(3)
    head, rod, share = rng.uniform(2e6, 9e6, 60), rng.uniform(2e6, 9e6, 60), rng.uniform(0.0, 1.0, 60)
    signals: Any = SimpleNamespace(inlet=(head, rod), tank=5e5 * one)
    columns = np.stack(list(EFFECTS["port_leak"].columns(signals, share, (5e-3, 3e-3)).values()), axis=1)
    for lost in (-share * (head - 5e5) / 5e-3, (1.0 - share) * (rod - 5e5) / 3e-3):
        found = np.linalg.lstsq(columns, 2e-12 * lost, rcond=None)[0]
        assert np.allclose(columns @ found, 2e-12 * lost) and np.allclose(sorted(found), [0.0, 2e-12], atol=1e-18)


def test_the_last_way_it_was_told_to_go_is_kept_at_rest_and_forgotten_in_a_gap() -> None:
    u = np.array([0.0, 0.2, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 0.3])
    signals = replace(_signals(u), first=np.where(np.arange(9) < 6, 0, 6))
    assert signals.last_way.tolist() == [0.0, 1.0, 1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 1.0]


def test_what_a_parameter_moves_by_without_a_block_is_what_a_fit_without_it_gives() -> None:
    rng = np.random.default_rng(5)
    J = rng.normal(size=(90, 4))
    J /= np.linalg.norm(J, axis=0)
    y = rng.normal(size=90)
    here = np.linalg.lstsq(J, y, rcond=None)[0]
    blocks = np.array_split(np.arange(90), 6)
    moves = moved_without(J, y - J @ here, blocks, 1e-9)
    for block, move in zip(blocks, moves, strict=True):
        rest = np.setdiff1d(np.arange(90), block)
        there = np.linalg.lstsq(J[rest], y[rest], rcond=None)[0]
        assert np.allclose(move, there - here, atol=1e-6)


def test_bars_hold_what_they_say_where_few_events_tell_and_the_noise_hangs_together() -> None:
    """Oracle: 400 draws of a parameter that six short events tell of, in noise that lasts half a second."""
    rng, rows = np.random.default_rng(7), 600
    J = np.zeros((rows, 3))
    for start in range(40, rows, 100):
        J[start : start + 6, 0] = 1.0
        J[start : start + 12, 1] = np.linspace(1.0, 0.0, 12)
    J[:, 2] = 1.0
    J /= np.linalg.norm(J, axis=0)
    blocks = np.array_split(np.arange(rows), 12)
    inside = []
    for _ in range(400):
        noise = signal.lfilter([1.0], [1.0, -0.75], rng.normal(size=rows))
        error = np.linalg.lstsq(J, noise, rcond=None)[0]
        moves = moved_without(J, noise - J @ error, blocks, 1e-9)
        inside.append(abs(error[0]) <= 1.96 * np.sqrt(np.sum(moves[:, 0] ** 2)))
    assert 0.9 <= np.mean(inside) <= 0.99


@given(st.integers(1, 40), st.integers(0, 40), st.floats(1e-3, 1e3))
def test_degrees_of_freedom_are_those_of_the_blocks_that_tell(telling: int, silent: int, size: float) -> None:
    moves = np.random.default_rng(telling).normal(size=(telling, 50))
    freedom = freedom_of(moves)
    assert np.all(freedom >= 3.0) and np.all(freedom <= 3.0 * telling * (1.0 + 1e-9))
    assert np.allclose(freedom_of(size * np.append(moves, np.zeros((silent, 50)), axis=0)), freedom)


def test_an_interval_that_three_blocks_tell_of_holds_what_it_says() -> None:
    """Oracle: 4000 draws of what 20 blocks move, of which three tell nearly all."""
    rng, sizes = np.random.default_rng(11), np.where(np.arange(20) < 3, 1.0, 0.1)[:, None]
    errors, moves = (sizes * rng.normal(size=(20, 4000)) for _ in range(2))
    off, std = np.abs(errors.sum(axis=0)), np.sqrt(np.sum(moves**2, axis=0))
    assert np.mean(off <= 1.96 * std) < 0.88
    assert 0.9 <= np.mean(off <= stats.t.ppf(0.975, freedom_of(moves)) * std) <= 0.98


def local_of(seed: int, rows: int = 60, noise: float = 0.1) -> tuple[Local, np.ndarray]:
    """A linear model whose three parameters are each known to its own size before any data, and what was measured."""
    rng, wide = np.random.default_rng(seed), np.array([0.7, 1.4, 0.2])
    J = rng.normal(size=(rows, 3))
    y = J @ wide + noise * rng.normal(size=rows)
    r = y - J @ np.linalg.lstsq(J, y, rcond=None)[0]
    variance = float(r @ r) / rows
    return Local(J * wide, r, variance * np.eye(3), variance, float(rows)), y


def test_the_density_of_what_is_left_out_is_that_of_a_gaussian() -> None:
    """Oracle: the conditional density by whole covariance matrices, of each part given the others."""
    model, _ = local_of(9)
    J, r, variance = model.columns, model.residual, model.noise
    folds = [np.arange(60) // 20 == k for k in range(3)]
    for fold, square, open_one in zip(folds, *model.left_out(folds), strict=True):
        known = np.eye(3) + J[~fold].T @ J[~fold] / variance
        spread = variance * np.eye(20) + J[fold] @ np.linalg.solve(known, J[fold].T)
        e = r[fold] - J[fold] @ np.linalg.solve(known, J[~fold].T @ r[~fold] / variance)
        assert square / variance == pytest.approx(float(e @ np.linalg.solve(spread, e)), rel=1e-6)
        assert open_one == pytest.approx(float(np.linalg.slogdet(spread / variance)[1]), rel=1e-6)


def test_one_block_shows_nothing_of_what_others_would_say() -> None:
    model, _ = local_of(9)
    worse = replace(model, residual=2.0 * model.residual)
    rows, thirds = [np.ones(60, dtype=bool)], [np.arange(60) // 20 == k for k in range(3)]
    held, after, before = beside(worse, model, thirds, rows)
    assert (held.gain, held.z, held.blocks) == (0.0, 0.0, 1)
    assert before == pytest.approx(4.0 * after, rel=0.2)


def test_another_motion_weighs_models_by_the_density_of_its_rows() -> None:
    """Oracle: two Gaussians by whole covariance matrices; it confirms what is there and refuses what is not."""
    rng, (model, _) = np.random.default_rng(4), local_of(9)
    there, old = rng.normal(size=(80, 3)), 0.1 * rng.normal(size=80)
    for shift in (0.2, -0.2):
        new = old + shift * there[:, 0]
        one, other = (replace(model, columns=there, residual=own, rows=80.0) for own in (old, new))
        seen = elsewhere((model, one), (model, other))
        scale = min(float(old @ old), float(new @ new)) / 80.0
        spread = scale * np.eye(80) + there @ model.covariance @ there.T
        densities = [stats.multivariate_normal.logpdf(own, np.zeros(80), spread) for own in (old, new)]
        assert seen.predicted == pytest.approx(2.0 * (densities[1] - densities[0]), rel=1e-6)
        assert seen.refutes and seen.gain == pytest.approx(float(old @ old - new @ new) / scale)
        assert not elsewhere((model, other), (model, one)).refutes


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_a_curve_is_as_large_as_it_is_and_none_where_there_is_none(size: float) -> None:
    model, _ = local_of(9, rows=400)
    z = np.random.default_rng(2).uniform(-1.0, 1.0, 400)
    basis = evaluate(spline_knots(z, 8), z)
    true = size * np.sin(2.0 * z)
    there = replace(model, residual=model.residual + true)
    with_it, values = with_curve(there, basis)
    shown = basis @ values[3:]
    # The mean of a curve is a gain's, too: it is told apart from no other parameter here.
    assert np.std(shown - true) < 0.03
    assert np.std(with_it.residual) == pytest.approx(np.std(model.residual), rel=0.05)


@pytest.mark.slow
def test_a_curve_means_the_same_on_a_motion_of_smaller_and_of_larger_commands() -> None:
    machine = machine_of()
    axis = axis_of(machine, machine.joints[0], [recording(Bench(), seed) for seed in (1, 2)])
    fit = fitted(axis, Structure(("meter_in", "meter_in"), "monotone", True))
    for scale in (0.6, 1.25):
        own = axis_of(machine, machine.joints[0], [recording(Bench(largest=0.7 * scale), 5)], like=axis)
        assert own.largest == axis.largest != axis_of(machine, machine.joints[0], [recording(Bench(), 5)]).largest
        assert relative(own, own.speed - predicted(own, fit)) < 0.02


@settings(max_examples=40)
@given(st.integers(1, 60), st.integers(1, 5), st.integers(0, 10_000))
def test_linear_parameters_are_never_negative_and_never_worse_than_nothing(rows: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, y = rng.normal(size=(rows + 5, count)), rng.normal(size=rows + 5)
    found = solved(matrix, y)
    assert np.all(found >= 0)
    assert np.linalg.norm(y - matrix @ found) <= np.linalg.norm(y) * (1 + 1e-9)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.id)
def test_every_law_is_one_at_its_references_and_never_falls_with_the_drop(law: Any) -> None:
    shape = {name: bounds[0] for name, bounds in law.shape.items()}
    reference, drop = np.array([1e7, 2e6]), np.linspace(0.0, 3.0, 50)
    one = law.factor(np.ones(1), np.ones(1), reference, shape)
    assert one[0] == pytest.approx(1.0)
    both = law.factor(drop, drop, reference, shape)
    assert np.all(np.diff(both) >= 0) and np.all(both >= 0)
    assert np.all(law.factor(-drop, -drop, reference, shape) <= both + 1e-12)


def test_laws_are_those_that_can_be_known() -> None:
    assert laws_for(pressures=False, supply=False, compensated="unknown") == ("none",)
    assert "meter_in" not in laws_for(pressures=True, supply=False, compensated="unknown")
    assert set(laws_for(pressures=True, supply=True, compensated=True)) == {"none", "compensated"}
    assert "compensated" not in laws_for(pressures=True, supply=True, compensated=False)
    assert "meter_out" not in laws_for(pressures=True, supply=True, compensated="unknown"), "an effect there"


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda effect: effect.id)
def test_every_effect_says_what_it_is_and_changes_what_is_predicted(effect: Any) -> None:
    assert effect.level == "valve" and effect.title and effect.equation and effect.experiment and effect.look_at
    assert all(name.startswith(f"{effect.id}.") for name in effect.shape)
    assert set(effect.units) <= set(effect.shape)
    assert all(set(start) <= set(effect.shape) for start in effect.starts)
    assert all(low <= start <= high for start, low, high in effect.shape.values())
    assert set(effect.confounders) <= set(EFFECTS) - {effect.id}


@pytest.mark.slow
def test_rows_are_left_out_where_something_else_decides_the_speed() -> None:
    machine = machine_of()

    def kept(**change: Any) -> float:
        return float(axis_of(machine, machine.joints[0], [recording(Bench(), **change)]).keep.mean())

    def in_the_middle(value: float) -> Callable[[np.ndarray], np.ndarray]:
        def changed(own: np.ndarray) -> np.ndarray:
            own = own.copy()
            own[600:900] = value
            return own

        return changed

    whole = kept()
    assert whole > 0.85
    assert kept(head=in_the_middle(1e5), rod=in_the_middle(1e5)) < whole - 0.1  # cavitation, in both directions
    assert kept(ps=in_the_middle(5e6)) < whole - 0.05  # nothing between supply and the chamber
    assert kept(x=in_the_middle(0.599)) < whole - 0.1  # at the rod's end


def test_oil_that_a_make_up_valve_lets_in_behind_a_shut_valve_is_left_out() -> None:
    machine = machine_of()

    def shut(own: np.ndarray) -> np.ndarray:
        return np.concatenate([np.full(600, 0.3), np.zeros(300), np.full(len(own) - 900, 0.3)])  # extended last

    def kept(**change: Any) -> float:
        return float(axis_of(machine, machine.joints[0], [recording(Bench(), u=shut, **change)]).keep.mean())

    def in_the_middle(value: float) -> Callable[[np.ndarray], np.ndarray]:
        return lambda own: np.concatenate([own[:600], np.full(300, value), own[900:]])

    whole = kept(head=in_the_middle(TANK + 1e5))
    assert kept(head=in_the_middle(TANK - 1e5)) < whole - 0.1
    assert kept(head=in_the_middle(TANK + 1e5), rod=in_the_middle(TANK - 1e5)) == whole, "the side that is not filled"


def test_another_unit_neutral_and_sign_of_the_command_change_nothing() -> None:
    sent = machine_of(unit="mA", range=[4.0, 20.0], neutral=12.0, extends=-1)
    plain = machine_of()
    one = axis_of(plain, plain.joints[0], [recording(Bench())])
    other = axis_of(sent, sent.joints[0], [recording(Bench(), machine=sent, u=lambda u: 12.0 - 8.0 * u)])
    np.testing.assert_allclose(other.signals.u, one.signals.u, atol=1e-12)
    # Without pressures and a lag the damping is free: rounding decides where in a flat valley a search ends.
    assert fitted(one, Structure()).shape["edge.extend"] == pytest.approx(
        fitted(other, Structure()).shape["edge.extend"], abs=1e-4
    )


def _signals(u: np.ndarray) -> Signals:
    count = len(u)
    two, one = np.full((2, count), np.nan), np.full(count, np.nan)
    return Signals(
        recording=np.zeros(count, dtype=np.int64), first=np.zeros(count, dtype=np.int64), clock=one, u=u, x=one,
        inlet=two, rates=two, supply=one, tank=one, temperature=one, taken=one,
    )  # fmt: skip


# --- the inverse --------------------------------------------------------------------------------------------------


def direction(**change: Any) -> Direction:
    own: dict[str, Any] = {
        "edge": 0.06, "gain": 0.3, "power": 1.0, "openings": (), "speeds": (), "law": "meter_in", "law_shape": {},
        "drop_in": 1e7, "drop_out": 1e6, "largest": 0.8,
    }  # fmt: skip
    return Direction(**own | change)


def model(**change: Any) -> ValveModel:
    own: dict[str, Any] = {
        "joint": "boom", "unit": "mA", "neutral": 12.0, "full": 8.0, "extends": -1, "least": 4.0, "most": 20.0,
        "delay": 0.1, "directions": (direction(), direction(edge=0.12, gain=0.25)), "areas": (5e-3, 3.4e-3),
        "pump_limit": None, "left_out": (), "error": 0.01,
    }  # fmt: skip
    return ValveModel(**own | change)


@given(
    st.floats(0.02, 0.18), st.sampled_from([1.0, -1.0]), st.floats(1e6, 1.5e7), st.sampled_from([1.0, 1.4]),
    st.sampled_from(["none", "meter_in"]),
)  # fmt: skip
def test_the_inverse_gives_the_speed_back(speed: float, sign: float, filled: float, power: float, law: str) -> None:
    own = model(directions=(direction(power=power, law=law), direction(edge=0.12, gain=0.25, power=power, law=law)))
    found = own.command(sign * speed, head=filled, rod=filled, supply=1.8e7)
    assert (found.share > 0) == (sign > 0) and found.command == pytest.approx(12.0 - 8.0 * found.share)
    if found.flags & CLIPPED:
        return
    way = own.directions[0 if sign > 0 else 1]
    factor = np.sqrt((1.8e7 - filled) / way.drop_in) if law == "meter_in" else 1.0
    assert way.gain * (abs(found.share) - way.edge) ** power * factor == pytest.approx(speed, rel=1e-9)


def test_the_inverse_rests_clips_and_says_so() -> None:
    own = model()
    low = REST_SHARE * own.directions[0].fastest
    assert own.command(0.9 * low).command == 12.0 and own.command(0.9 * low).flags == 0
    assert own.command(2.0 * low, moving=True).share > 0.06
    assert own.command(2.0 * low, moving=False).share == 0.0  # starts above three times of it
    assert own.command(3.1 * low, moving=False).share > 0.06
    fast = own.command(5.0, head=8e6, rod=3e6, supply=1.8e7)
    assert fast.flags == CLIPPED and fast.share == 0.8
    for bad in (np.nan, np.inf):
        assert own.command(bad).command == 12.0 and own.command(bad).flags == NO_NUMBER
    assert own.command(0.1).flags == NO_PRESSURE
    assert own.command(0.1, head=1.8e7, rod=0.0, supply=1.8e7).flags == NO_PRESSURE  # no drop is left


def test_a_free_curve_is_inverted_piece_by_piece() -> None:
    bent = direction(law="none", openings=(0.0, 0.1, 0.3, 0.7), speeds=(0.0, 0.05, 0.09, 0.09))
    for speed in (0.02, 0.05, 0.08):
        assert bent.speed(bent.opening(speed)) == pytest.approx(speed)
    assert bent.opening(1.0) == pytest.approx(0.3)  # what is before a flat piece is enough


def test_the_pump_scales_all_wanted_speeds() -> None:
    limited = model(pump_limit=1e-3)
    both = {"boom": limited, "stick": limited}
    assert limited.scale({"boom": 0.05, "stick": -0.05}, both) == 1.0
    asked = 5e-3 * 0.2 + 3.4e-3 * 0.2
    assert limited.scale({"boom": 0.2, "stick": -0.2}, both) == pytest.approx(1e-3 / asked)
    assert model().scale({"boom": 9.0}, both) == 1.0


def test_a_model_goes_through_json_unchanged() -> None:
    own = model(directions=(direction(), direction(openings=(0.0, 0.5), speeds=(0.0, 0.1))))
    assert ValveModel.from_json(own.to_json()) == own
    with pytest.raises(InputError, match="not a valve's model"):
        ValveModel.from_json({"schema": "something"})


@pytest.mark.slow
def test_the_report_is_plain_json(tmp_path: Path, identified: Identify) -> None:
    import json

    report = identify_valves(machine_of(), [recording(Bench())], [], loop=False).report
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["schema"] == "hilfit/valve/1" and report["axes"]["boom"]["errors"]["role"] == "train"
