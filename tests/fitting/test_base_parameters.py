"""Base parameters: published counts, independent ranks, and efforts that stay the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm_examples import RIGHT, chain, driven_arm, inverse_dynamics, planar_arm, puma_560, random_chain, sample_machine
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.arm.base_parameters import (
    BaseParameters,
    base_regressor,
    condition_number,
    reduce_parameters,
    unidentifiable,
)
from fitting.arm.dynamics import rigid_body_regressor, stacked, standard_regressor
from fitting.arm.geometry import Geometry


def independent_rank(arm, make=rigid_body_regressor, samples: int = 400) -> int:
    """Rank of the regressor by singular values, at states that the reduction has not seen."""
    n = arm.joints if isinstance(arm, Geometry) else len(arm.joints)
    q, qd, qdd = np.random.default_rng(99).uniform(-1.5, 1.5, (3, samples, n))
    W = stacked(make(arm, q, qd, qdd))
    norms = np.linalg.norm(W, axis=0)
    there = norms > 1e-12 * norms.max()  # a column of round-off is no column
    values = np.linalg.svd(W[:, there] / norms[there], compute_uv=False)
    return int((values > 1e-9 * values[0]).sum())


def test_folding_arm_78_to_18():
    """Six parallel horizontal axes: ZZ, MX and MY of every link, the masses beyond regrouped into them."""
    base = reduce_parameters(driven_arm(6))
    assert base.standard_count == 78
    assert len(base) == 18
    assert base.names == tuple(f"{symbol}{i}" for i in range(1, 7) for symbol in ("ZZ", "MX", "MY"))
    a = 0.8 - 0.1 * np.arange(6)
    # With the frame at the link's far end a mass m beyond it adds m a to MX and -m a^2 to ZZ (taken about that end).
    assert base.expressions[1] == "MX1 + 0.8 (m1 + m2 + m3 + m4 + m5 + m6)"
    assert base.expressions[0] == f"ZZ1 - {a[0] ** 2:.4g} (m1 + m2 + m3 + m4 + m5 + m6)"
    assert base.expressions[-1] == "MY6"
    assert base.expressions[-2] == "MX6 + 0.3 m6"
    assert base.units[:3] == ("kg m^2", "kg m", "kg m")


def test_sample_folding_arm_78_to_18():
    base = reduce_parameters(sample_machine("nothing-missing"))
    assert (base.standard_count, len(base)) == (78, 18)


def test_puma_560_has_36():
    """Gautier 1991 (J. Robotic Systems 8) and Mayeda et al. 1990 (IEEE T-RA 6): 36 base inertial parameters."""
    base = reduce_parameters(puma_560())
    assert len(base) == 36
    assert independent_rank(puma_560()) == 36
    # Of the first link only the inertia about its (vertical) axis is left; it is y of the distal frame.
    assert [name for name in base.names if name.endswith("1")] == ["YY1"]


def test_slewing_arm_against_an_independent_rank():
    machine = sample_machine("tilted-base")
    assert len(reduce_parameters(machine)) == independent_rank(machine) == 36
    with_friction = reduce_parameters(machine, friction_by_stage_1=False)
    # 36 + f_c and f_v of six joints + drive inertias, of which those of joints 1 and 2 regroup with link inertias.
    assert len(with_friction) == independent_rank(machine, standard_regressor) == 36 + 12 + 4


@pytest.mark.parametrize(
    ("gravity", "count"),
    [((0.0, -9.81, 0.0), 9), ((0.0, 0.0, -9.81), 7), ((0.0, 0.0, 0.0), 7)],
    ids=["upright", "lying", "weightless"],
)
def test_gravity_across_the_axes_tells_two_more(gravity, count):
    """Lying or weightless, MX1 and MY1 of a planar arm do nothing."""
    base = reduce_parameters(planar_arm(3, gravity))
    assert len(base) == count
    assert ("MX1" in base.names) == (count == 9)
    assert ("MY1" in base.vanished) == (count == 7)


def test_one_slide_has_its_mass_and_its_drive():
    slide = chain("P", [0.0], [0.0], [0.0], [0.0, 0.0, 0.0])
    assert reduce_parameters(slide).expressions == ("m1",)
    full = reduce_parameters(slide, friction_by_stage_1=False)
    assert full.expressions == ("m1 + J1", "f_c1", "f_v1")
    assert full.units == ("kg", "N", "N s/m")


def test_friction_and_drive_of_a_planar_arm():
    full = reduce_parameters(planar_arm(6), friction_by_stage_1=False)
    # 18, two friction terms per joint, and five drive inertias: the first turns with link 1.
    assert len(full) == 18 + 12 + 5
    assert full.expressions[0].endswith("+ J1")
    q, qd, qdd = np.random.default_rng(0).uniform(-1, 1, (3, 40, 6))
    pi = np.random.default_rng(1).normal(size=78)
    tau = inverse_dynamics(planar_arm(6), pi, q, qd, qdd)
    found = base_regressor(planar_arm(6), full, q, qd, qdd) @ full.from_standard(pi)
    np.testing.assert_allclose(found, tau, atol=1e-10 * np.abs(tau).max())


def test_rounded_half_turns_do_not_add_parameters():
    """Axes turned over with 3.1416 are meant to be parallel; the 7e-6 rad would formally make more identifiable."""
    exact = replace(planar_arm(3), alpha=np.full(3, np.pi))
    rounded = replace(exact, alpha=np.full(3, 3.1416))
    assert len(reduce_parameters(exact)) == 9
    assert independent_rank(rounded) > 9
    assert len(reduce_parameters(rounded)) == 9


def check_same_efforts(arm: Geometry, base: BaseParameters, seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.uniform(-1.5, 1.5, (3, 30, arm.joints))
    pi = rng.normal(size=10 * arm.joints)
    Y = rigid_body_regressor(arm, q, qd, qdd)
    tau = Y @ pi
    scale = np.abs(tau).max()
    values = base.from_standard(pi)
    np.testing.assert_allclose(base.regressor(Y) @ values, tau, atol=1e-9 * scale)
    np.testing.assert_allclose(base_regressor(arm, base, q, qd, qdd) @ values, tau, atol=1e-9 * scale)
    example = np.zeros(10 * arm.joints)
    example[base.independent] = values  # each on its kept column, the rest zero: the same efforts
    np.testing.assert_allclose(Y @ example, tau, atol=1e-9 * scale)


@settings(max_examples=25, deadline=None)
@given(kinds=st.text("RP", min_size=1, max_size=6), seed=st.integers(0, 10_000), square=st.booleans())
def test_any_chain_keeps_its_efforts_and_has_the_rank_of_its_regressor(kinds, seed, square):
    arm = random_chain(kinds, np.random.default_rng(seed), square=square).squared_up()
    base = reduce_parameters(arm)
    assert len(base) == independent_rank(arm)
    below, above = base.gap
    assert below < 1e-11
    assert above > 1e-6
    check_same_efforts(arm, base, seed)
    # A base parameter's own column is not regrouped into another.
    np.testing.assert_array_equal(base.regrouping[:, base.independent], np.eye(len(base)))


@pytest.mark.parametrize("arm", [puma_560(), planar_arm(6)], ids=["PUMA 560", "planar"])
def test_known_arms_keep_their_efforts(arm):
    check_same_efforts(arm, reduce_parameters(arm), 5)


def test_the_choice_does_not_depend_on_the_random_states():
    first, second = (reduce_parameters(puma_560(), seed=seed) for seed in (0, 1))
    assert first.expressions == second.expressions
    np.testing.assert_allclose(first.regrouping, second.regrouping, atol=1e-9)


def test_a_wheel_has_one_inertia_and_a_foreign_regressor_is_refused():
    wheel = chain("R", [RIGHT], [0.0], [0.0], [0.0, 0.0, 0.0])
    assert reduce_parameters(wheel).names == ("YY1",)  # the axis is y of the distal frame
    with pytest.raises(ValueError, match="13 columns"):
        reduce_parameters(wheel).regressor(np.zeros((3, 1, 13)))


def test_unidentifiable_names_what_a_motion_cannot_tell():
    arm = planar_arm(3)
    base = reduce_parameters(arm)
    q, qd, qdd = np.random.default_rng(2).uniform(-1, 1, (3, 200, 3))
    assert unidentifiable(stacked(base_regressor(arm, base, q, qd, qdd)), base) == []
    # At rest in many poses: gravity tells the first moments, nothing tells the inertias.
    still = np.zeros_like(q)
    assert unidentifiable(stacked(base_regressor(arm, base, q, still, still)), base) == ["ZZ1", "ZZ2", "ZZ3"]
    # One pose only: each joint gives one equation for its MX and MY, so neither is told, only a combination.
    one_pose = np.tile(q[:1], (200, 1))
    assert unidentifiable(stacked(base_regressor(arm, base, one_pose, still, still)), base) == list(base.names)
    # That pose stretched out level: MY lies in the direction of gravity and does nothing, MX is told.
    W = stacked(base_regressor(arm, base, still, still, still))
    assert unidentifiable(W, base) == [name for name in base.names if not name.startswith("MX")]
    # Only joint 1 moves: all is told but what needs the others' speeds, and what is not named has full rank.
    first = [array * np.array([1.0, 0.0, 0.0]) for array in (q, qd, qdd)]
    W = stacked(base_regressor(arm, base, *first))
    lost = unidentifiable(W, base)
    rest = [k for k, name in enumerate(base.names) if name not in lost]
    assert np.linalg.matrix_rank(W[:, rest], tol=1e-9) == len(rest)


def test_unidentifiable_of_a_pair_names_both_and_of_noise_neither():
    rng = np.random.default_rng(3)
    W = rng.normal(size=(500, 4))
    W[:, 2] = 1e-6 * (W[:, 1] + 1e-4 * rng.normal(size=500))
    names = ["a", "b", "c", "d"]
    assert unidentifiable(W, names) == []
    assert unidentifiable(W, names, rtol=1e-3) == ["b", "c"]
    W[:, 3] = 0.0
    assert unidentifiable(W, names, rtol=1e-3) == ["b", "c", "d"]
    assert unidentifiable(np.linalg.qr(W, mode="r"), names, rtol=1e-3) == ["b", "c", "d"]
    assert unidentifiable(np.zeros((5, 4)), names) == names
    # Fewer rows than columns: something is always left over.
    assert unidentifiable(W[:1, :2], ["a", "b"]) == ["a", "b"]
    with pytest.raises(ValueError, match="2 names"):
        unidentifiable(W, ["a", "b"])


def test_condition_number_is_that_of_the_scaled_matrix_and_ignores_units():
    rng = np.random.default_rng(4)
    W = rng.normal(size=(300, 5)) @ np.diag([1, 1e3, 1e-3, 1, 1])
    scaled = W / np.linalg.norm(W, axis=0)
    assert condition_number(W) == pytest.approx(np.linalg.cond(scaled), rel=1e-10)
    assert condition_number(W * np.array([1e6, 1, 1, 1, 1e-6])) == pytest.approx(condition_number(W), rel=1e-10)
    W[:, 2] = 0.0
    assert condition_number(W) == np.inf
