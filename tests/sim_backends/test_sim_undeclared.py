"""Undeclared effects, one by one: what each changes, where, and that size 0 is the plant without it."""

from __future__ import annotations

import numpy as np
import pytest

from daq.errors import InputError
from sim_backends import (
    UNDECLARED,
    EffectSpec,
    SensorQuality,
    default_machine,
    folding_arm,
    make_case,
    random_motion,
    record,
    simulate_case,
    slewing_arm,
)
from sim_backends.undeclared import MISMATCH, OUTSIDE_MISMATCH, check_spec, parse_spec
from sim_backends.undeclared.base import UndeclaredEffect

pytestmark = pytest.mark.slow

QUIET = SensorQuality.perfect()
JOINT = "joint2"
# The link of joint2 stands behind no parallel axis: its inclination is the joint's own angle, and nothing comes of it.
ELSEWHERE = {"lying_rod": "joint3"}

# A size at which each effect is plain, in its own unit.
SIZES = {
    "load_dependent_friction": 150.0, "pressure_dependent_friction": 120.0, "asymmetric_friction": 60.0,
    "stribeck": 80.0, "presliding_hysteresis": 80.0, "lubricant_film_lag": 100.0,
    "position_dependent_friction": 75.0, "velocity_root_friction": 60.0, "thermal_viscosity_drift": 800.0,
    "pose_dependent_friction": 20.0, "quadratic_loss": 100.0, "end_cushion": 200.0, "gas_spring": 300.0,
    "counterbalance_valve": 150.0, "cross_cylinder_coupling": 80.0, "position_harmonic": 40.0,
    "hose_stiffness": 30.0, "actuator_inertia": 10.0, "carried_liquid": 20.0, "structural_flexibility": 2.0e-6,
    "supply_ripple": 20.0e3, "pressure_offset": 50.0e3, "pressure_gain": 0.05, "pressure_drift": 50.0e3,
    "sensor_latency": 0.02, "encoder_offset": 0.01, "encoder_eccentricity": 0.003, "backlash": 0.5e-3,
    "linkage_geometry": 2.0e-3, "base_tilt": 0.03, "payload": 15.0, "bent_guide": 120.0, "threshold_spring": 150.0,
    "neighbour_product_friction": 80.0, "saturating_coupling": 80.0, "dwell_stiction": 60.0,
    "neighbour_inertia": 200.0, "dented_rod": 120.0, "return_line": 200.0, "hanging_hose": 120.0,
    "squeezed_guide": 60.0, "wiped_film": 80.0, "lying_rod": 80.0, "starved_inflow": 150.0, "shared_gallery": 300.0,
    "pilot_line": 150.0, "cylinder_compliance": 1.0e-7, "joint_compliance": 1.0e-6, "pin_play": 0.5e-3,
    "joint_play": 2.0e-3, "hardening_structure": 0.5e-3, "warming_scale": 0.2e-3, "bending_frame": 0.1e-3,
    "scale_wave": 0.05e-3,
}  # fmt: skip
# Gone when the rods are unpinned: they come from the load, act on the joint, or need the neighbours out of mid-pose.
LOADED_ONLY = {
    "load_dependent_friction", "counterbalance_valve", "pose_dependent_friction", "hose_stiffness",
    "actuator_inertia", "carried_liquid", "structural_flexibility", "linkage_geometry", "base_tilt", "payload",
    "backlash", "neighbour_product_friction", "hanging_hose", "squeezed_guide", "lying_rod", *MISMATCH,
    *OUTSIDE_MISMATCH,
}  # fmt: skip
PRESSURES_ONLY = {"supply_ripple", "pressure_offset", "pressure_gain", "pressure_drift", "sensor_latency"}
ENCODER_ONLY = {"encoder_offset", "encoder_eccentricity"}
CATALOGUE = set(SIZES) - {
    "bent_guide", "threshold_spring", "neighbour_product_friction", "saturating_coupling", "dwell_stiction",
    "neighbour_inertia", "dented_rod", "return_line", "hanging_hose", "squeezed_guide", "wiped_film", "lying_rod",
    "starved_inflow", "shared_gallery", "pilot_line", *MISMATCH, *OUTSIDE_MISMATCH,
}  # fmt: skip


def spec(effect: str, size: float) -> EffectSpec:
    return EffectSpec(effect, None if UNDECLARED[effect].base_wide else ELSEWHERE.get(effect, JOINT), size)


@pytest.fixture(scope="module")
def pinned():
    machine, truth = slewing_arm(4)  # base tilt shows on it, unlike on a planar arm
    motion = random_motion(machine, np.random.default_rng(2), 10.0)
    return machine, truth, motion, tables(machine, truth, motion, ())


@pytest.fixture(scope="module")
def unpinned():
    machine, truth = slewing_arm(4)
    motion = random_motion(machine, np.random.default_rng(3), 10.0, rods="unpinned")
    return machine, truth, motion, tables(machine, truth, motion, ())


@pytest.fixture(scope="module")
def noisy():
    machine, truth = slewing_arm(4)
    motion = random_motion(machine, np.random.default_rng(2), 4.0)
    return machine, truth, motion, tables(machine, truth, motion, (), SensorQuality())


def tables(machine, truth, motion, undeclared, quality=QUIET):
    return record(
        machine, truth, motion, undeclared=undeclared, quality=quality,
        rng=np.random.default_rng(0), shapes=np.random.default_rng(8),
    )  # fmt: skip


def changed(table, plain) -> set[str]:
    return {name for name in plain if np.abs(table[name] - plain[name]).max() > 1e-9 * np.abs(plain[name]).max()}


def test_every_effect_is_registered_and_documented():
    assert set(SIZES) == set(UNDECLARED)
    for name, effect in UNDECLARED.items():
        assert effect.id == name and effect.unit and effect.meaning and effect.__doc__ != UndeclaredEffect.__doc__


@pytest.mark.parametrize("effect", sorted(set(SIZES) - {"payload"}))  # that one has a test of its own
def test_loaded(effect, pinned):
    machine, truth, motion, plain = pinned
    table = tables(machine, truth, motion, [spec(effect, SIZES[effect])])
    names = changed(table, plain)
    assert names, "a plain size must show"
    if effect in ENCODER_ONLY:
        assert names == {f"{JOINT}.angle"}
    elif effect in PRESSURES_ONLY:
        assert names <= {f"{JOINT}.head_pressure", f"{JOINT}.rod_pressure"}
    elif effect in (*MISMATCH, *OUTSIDE_MISMATCH):
        assert names == {f"{JOINT}.piston_position"}
    elif UNDECLARED[effect].base_wide:
        assert {n.split(".")[1] for n in names} <= {"head_pressure", "rod_pressure"}
        assert len({n.split(".")[0] for n in names}) > 2, "all joints at once"
    elif effect == "structural_flexibility":
        assert {f"{JOINT}.head_pressure"} <= names and not any("angle" in n or "piston" in n for n in names)
    else:
        assert {n.split(".")[0] for n in names} == {ELSEWHERE.get(effect, JOINT)}, "only its own joint"
        assert ("piston_position" in str(names)) == (effect in ("backlash", "linkage_geometry"))
    pressures = [n for n in names if "pressure" in n]
    assert all(table[n].min() > 0 for n in pressures)
    for name in pressures:  # a defect, not another machine
        assert np.abs(table[name] - plain[name]).max() < 0.5 * np.abs(plain[name]).max()


@pytest.mark.parametrize("effect", sorted(SIZES))
def test_unloaded(effect, unpinned):
    machine, truth, motion, plain = unpinned
    table = tables(machine, truth, motion, [spec(effect, SIZES[effect])])
    names = changed(table, plain)
    if effect in LOADED_ONLY:
        assert {n for n in names if "pressure" in n} == set(), "the unpinned cylinder knows nothing of the arm"
    elif effect in ENCODER_ONLY:
        assert names <= {f"{JOINT}.angle"}
    else:
        assert names & {f"{JOINT}.head_pressure", f"{JOINT}.rod_pressure"}


@pytest.mark.parametrize("effect", sorted(SIZES))
def test_size_zero_is_no_effect_at_all(effect, noisy):
    machine, truth, motion, plain = noisy
    table = tables(machine, truth, motion, [spec(effect, 0.0)], SensorQuality())
    for name in plain:
        np.testing.assert_allclose(table[name], plain[name], rtol=1e-9, atol=1e-12)


def force(machine, table, joint=JOINT):
    c = machine.joint(joint).cylinder
    return table[f"{joint}.head_pressure"] * c.head_area - table[f"{joint}.rod_pressure"] * c.rod_area


def test_friction_effects_turn_with_the_motion_and_forces_do_not(pinned):
    machine, truth, motion, plain = pinned
    v = np.gradient(plain[f"{JOINT}.piston_position"], 0.02)
    clear = np.abs(v) > 5e-3
    for effect in ("load_dependent_friction", "pressure_dependent_friction", "velocity_root_friction", "bent_guide"):
        extra = force(machine, tables(machine, truth, motion, [spec(effect, SIZES[effect])])) - force(machine, plain)
        assert np.all((extra * np.sign(v))[clear] > -1e-6), effect
        assert np.abs(extra).max() <= 4 * SIZES[effect]
    extra = force(machine, tables(machine, truth, motion, [spec("gas_spring", 300.0)])) - force(machine, plain)
    x = plain[f"{JOINT}.piston_position"]
    assert np.all(np.diff(extra[np.argsort(x)]) > -1e-6), "monotone in position, whatever the speed"


@pytest.mark.parametrize("size", [30.0, 300.0])
def test_seals_feel_the_pressures_that_their_friction_makes(pinned, size):
    machine, truth, motion, plain = pinned
    table = tables(machine, truth, motion, [spec("pressure_dependent_friction", size)])
    p1, p2 = table[f"{JOINT}.head_pressure"], table[f"{JOINT}.rod_pressure"]
    v = np.gradient(plain[f"{JOINT}.piston_position"], 0.02)
    clear = np.abs(v) > 5e-3
    felt = size * ((0.6 * np.maximum(p1, p2) + 0.4 * p2) / 2.0e6) ** 0.95 * np.sign(v)
    np.testing.assert_allclose((force(machine, table) - force(machine, plain))[clear], felt[clear], atol=1e-4 * size)


def test_latency_is_a_delay_of_the_pressures(pinned):
    machine, truth, motion, plain = pinned
    table = tables(machine, truth, motion, [spec("sensor_latency", 0.02)])
    late, true = table[f"{JOINT}.head_pressure"], plain[f"{JOINT}.head_pressure"]
    np.testing.assert_allclose(late[50:], true[49:-1], rtol=1e-9)  # 20 ms are one sample
    half = tables(machine, truth, motion, [spec("sensor_latency", 0.0105)])[f"{JOINT}.head_pressure"]
    assert np.std(half - late) < np.std(true - late)


def test_geometry_and_encoder_errors_show_between_the_two_encoders(pinned):
    machine, truth, motion, _ = pinned
    linkage = machine.joint(JOINT).cylinder.linkage

    def gap(effect):
        table = tables(machine, truth, motion, [spec(effect, SIZES[effect])] if effect else ())
        return table[f"{JOINT}.piston_position"] - linkage.piston_position(table[f"{JOINT}.angle"])

    assert np.abs(gap("")).max() < 1e-9
    for effect in ("encoder_offset", "encoder_eccentricity", "linkage_geometry"):
        assert np.abs(gap(effect)).max() > 5e-5
    play = gap("backlash")  # half the play on the side of the load, which may cross zero
    assert np.abs(play).max() == pytest.approx(0.25e-3, rel=1e-6)


def test_a_payload_comes_in_the_middle_of_the_motion(pinned):
    machine, truth, _, _ = pinned
    motion = random_motion(machine, np.random.default_rng(2), 40.0)
    plain = tables(machine, truth, motion, ())
    extra = force(machine, tables(machine, truth, motion, [spec("payload", 15.0)])) - force(machine, plain)
    begins = np.flatnonzero(np.abs(extra) > 1.0)[0] * 0.02
    assert 15.0 <= begins <= 35.2
    assert np.abs(extra[:700]).max() < 1e-6


def test_warming_oil_shows_on_its_sensor_and_takes_friction_away():
    machine, truth = default_machine()
    motion = random_motion(machine, np.random.default_rng(2), 40.0)
    plain = tables(machine, truth, motion, ())
    table = tables(machine, truth, motion, [EffectSpec("thermal_viscosity_drift", JOINT, 800.0)])
    assert np.ptp(table["oil_temperature"]) > 10.0 > np.ptp(plain["oil_temperature"])
    v = np.gradient(plain[f"{JOINT}.piston_position"], 0.02)
    extra = force(machine, table) - force(machine, plain)
    slope = [np.polyfit(v[part], extra[part], 1)[0] for part in (slice(100, 500), slice(1500, 1990))]
    assert 800.0 > slope[0] > 2 * slope[1] > 0


def test_effects_add_up(pinned):
    machine, truth, motion, plain = pinned
    pair = [spec("gas_spring", 300.0), spec("bent_guide", 120.0)]
    both = force(machine, tables(machine, truth, motion, pair)) - force(machine, plain)
    alone = force(machine, tables(machine, truth, motion, pair[:1])) - force(machine, plain)
    other = both - alone  # the second one, with a hidden shape of its own
    v = np.gradient(plain[f"{JOINT}.piston_position"], 0.02)
    assert np.all((other * np.sign(v))[np.abs(v) > 5e-3] > -1e-6) and other.max() > 100.0


def test_a_case_on_disk_is_complete_and_repeats_by_its_seed(tmp_path):
    effects = [("position_dependent_friction", "joint2", 75.0)]
    case = make_case(tmp_path, "slewing", 7, effects, seconds=10.0)
    stems = {"unloaded", "train-1", "train-2", "repeat", "validate"}
    assert {p.name for p in tmp_path.iterdir()} == {f"{s}.parquet" for s in stems} | {"machine.yaml", "truth.yaml"}
    again = simulate_case("slewing", 7, effects, seconds=10.0)
    for stem in stems:
        for name, column in case.recordings[stem].items():
            np.testing.assert_array_equal(column, again.recordings[stem][name])
    train, repeat = case.recordings["train-1"], case.recordings["repeat"]
    difference = np.std(train["joint3.angle"] - repeat["joint3.angle"])
    assert 0 < difference < 1e-3 < np.std(train["joint3.angle"])
    assert "position_dependent_friction" not in (tmp_path / "machine.yaml").read_text()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bent_gide:joint1:5", "did you mean 'bent_guide'"),
        ("stribeck:joint9:5", "there is no joint 'joint9'"),
        ("stribeck:joint1:much", "is no number"),
        ("stribeck:joint1:nan", "finite"),
        ("stribeck", "write EFFECT:JOINT:SIZE"),
        ("base_tilt:joint1:0.1", "leave the joint out"),
        ("stribeck:5", "there is no joint"),
    ],
)
def test_wrong_effects_are_refused_with_one_line(text, says):
    machine, _ = folding_arm(0)
    with pytest.raises(InputError, match=says) as caught:
        parse_spec(text, machine)
    assert "\n" not in str(caught.value)


def test_base_wide_effects_need_no_joint():
    machine, _ = folding_arm(0)
    assert parse_spec("base_tilt:0.02", machine) == EffectSpec("base_tilt", None, 0.02)
    assert parse_spec("base_tilt::0.02", machine) == EffectSpec("base_tilt", None, 0.02)
    assert check_spec(EffectSpec("stribeck", "joint3", 5.0), machine).size == 5.0
    assert len(CATALOGUE) >= 31


@pytest.mark.parametrize(
    ("effect", "friction", "lever"),
    [("cylinder_compliance", f, 0) for f in (False, True)] + [("joint_compliance", f, 2) for f in (False, True)],
)
def test_compliance_follows_what_bends_it_where_it_sits(pinned, monkeypatch, effect, friction, lever):
    """The piston is ahead by the compliance times the force, far below its mode; about the joint by the lever twice."""
    machine, truth, motion, plain = pinned
    kind = UNDECLARED[effect]
    before = kind.prepare

    def prepare(self, rng):
        before(self, rng)
        self.feels_friction = friction

    monkeypatch.setattr(kind, "prepare", prepare)
    table = tables(machine, truth, motion, [spec(effect, SIZES[effect])])
    gap = table[f"{JOINT}.piston_position"] - plain[f"{JOINT}.piston_position"]
    linkage = machine.joint(JOINT).cylinder.linkage
    q = plain[f"{JOINT}.angle"]
    r = (linkage.piston_position(q + 1e-6) - linkage.piston_position(q - 1e-6)) / 2e-6
    wanted = SIZES[effect] * r**lever * force(machine, plain)
    friction_of = 2.0 * truth.cylinders[JOINT].f_c * SIZES[effect] * np.max(r**lever)
    assert np.std(gap - wanted) < (0.1 * np.std(wanted) if friction else 2.0 * friction_of)
    assert np.corrcoef(gap, wanted)[0, 1] > 0.95
