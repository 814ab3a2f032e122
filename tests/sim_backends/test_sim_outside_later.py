"""The later effects outside the catalogue: what each adds to the force, read from ideal recordings of other signals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.stats import spearmanr

from daq.errors import InputError
from sim_backends import EffectSpec, Plant, SensorQuality, excavator_front, random_motion, record, telescopic_crane
from sim_backends.undeclared import check_spec

QUIET = SensorQuality.perfect()


class Bench:
    """An arm, a motion, and its recordings without noise."""

    def __init__(self, arm) -> None:
        self.machine, self.truth = arm(2)
        self.motion = random_motion(self.machine, np.random.default_rng(1), 20.0)
        self.plain = self._record(())

    def _record(self, effects):
        return record(
            self.machine, self.truth, self.motion, undeclared=effects, quality=QUIET,
            rng=np.random.default_rng(0), shapes=np.random.default_rng(4),
        )  # fmt: skip

    def force(self, table, joint: str) -> np.ndarray:
        c = self.machine.joint(joint).cylinder
        return table[f"{joint}.head_pressure"] * c.head_area - table[f"{joint}.rod_pressure"] * c.rod_area

    def extra(self, effect: str, joint: str) -> np.ndarray:
        return self.force(self._record([EffectSpec(effect, joint, 1000.0)]), joint) - self.force(self.plain, joint)

    def built(self, effect: str, joint: str):
        rng, shapes = np.random.default_rng(0), np.random.default_rng(4)
        spec = EffectSpec(effect, joint, 1000.0)
        return Plant(self.machine, self.truth, undeclared=[spec], rng=rng, shapes=shapes).effects[0]

    def piston(self, joint: str) -> list[np.ndarray]:
        spline = make_interp_spline(self.plain["time"], self.plain[f"{joint}.piston_position"], k=5)
        return [spline.derivative(order)(self.plain["time"]) for order in (0, 1, 2)]


@pytest.fixture(scope="module")
def excavator() -> Bench:
    return Bench(excavator_front)


@pytest.fixture(scope="module")
def crane() -> Bench:
    return Bench(telescopic_crane)


def test_a_squeezed_guide_rubs_with_the_neighbours_force(excavator: Bench) -> None:
    extra, (_, v, _) = excavator.extra("squeezed_guide", "bucket"), excavator.piston("bucket")
    clear = np.abs(v) > 5e-3
    assert excavator.built("squeezed_guide", "bucket").variables()[0] == "stick.cylinder_force"
    assert (extra * np.sign(v))[clear].min() >= 0.0
    # The stick's own friction is in its chambers' force, but not in what its rod carries.
    assert spearmanr(np.abs(extra)[clear], np.abs(excavator.force(excavator.plain, "stick"))[clear])[0] > 0.9
    assert abs(spearmanr(np.abs(extra)[clear], np.abs(excavator.force(excavator.plain, "bucket"))[clear])[0]) < 0.8


def test_a_wiped_film_is_gone_after_a_distance_and_not_after_a_time(crane: Bench) -> None:
    extra, (x, v, _) = crane.extra("wiped_film", "telescope"), crane.piston("telescope")
    clear = np.abs(v) > 5e-3
    since = np.zeros_like(x)
    for k in range(1, len(x)):
        since[k] = since[k - 1] + abs(x[k] - x[k - 1]) if v[k] * v[k - 1] > 0 else 0.0
    later = clear & (np.cumsum(v[1:] * v[:-1] <= 0, dtype=int)[np.r_[0 : len(v) - 1, len(v) - 2]] > 0)
    assert (extra * np.sign(v))[clear].min() >= 0.0
    assert spearmanr(np.abs(extra)[later], since[later])[0] > 0.98
    assert np.abs(extra)[later & (since < 0.02)].max() < 0.05 * np.abs(extra).max()


def test_a_lying_rod_rubs_with_the_inclination_of_a_whole_chain(crane: Bench) -> None:
    extra, (_, v, _) = crane.extra("lying_rod", "telescope"), crane.piston("telescope")
    clear = np.abs(v) > 5e-3
    table, joints = crane.plain, crane.machine.joints
    # How far the slide is from level: theta of the knuckle counts from the boom's normal.
    level = sum(table[f"{j.name}.angle"] + j.dh.theta for j in joints[1:3]) - np.pi / 2
    askew = crane.built("lying_rod", "telescope").askew
    np.testing.assert_allclose((extra * np.sign(v))[clear], 1000.0 * np.cos(level + askew)[clear], atol=1.0)
    assert crane.built("lying_rod", "telescope").variables() == ("link_angle", "knuckle.link_angle")
    for joint in ("slew", "boom"):
        assert np.abs(crane.extra("lying_rod", joint)).max() == 0.0


def test_starved_inflow_pushes_only_while_the_piston_is_driven_outwards(excavator: Bench) -> None:
    extra, (_, _, a) = excavator.extra("starved_inflow", "stick"), excavator.piston("stick")
    assert extra.min() >= -1e-6 and extra.max() > 100.0
    inner = slice(20, -20)
    assert extra[inner][a[inner] < 0.0].max() < 0.1 * extra.max()
    assert spearmanr(extra[inner][a[inner] > 0.05], a[inner][a[inner] > 0.05])[0] > 0.99


def test_a_shared_gallery_throttles_only_what_fills_together(excavator: Bench) -> None:
    effect = excavator.built("shared_gallery", "stick")
    own, other = (name.rpartition(".")[0] or "stick" for name in effect.variables())
    extra = excavator.extra("shared_gallery", "stick")
    v, w = excavator.piston(own)[1], excavator.piston(other)[1]
    both, alone = (v > 0.02) & (w > 0.02), ((v > 0.02) & (w < -0.02)) | ((v < -0.02) & (w > 0.02))
    assert own == "stick" != other and both.sum() > 50 < alone.sum()
    assert extra[both].mean() > 5 * extra[alone].mean() > 0
    assert spearmanr(extra[both], (v * w)[both])[0] > 0.99


def test_a_pilot_line_holds_back_retracting_while_the_neighbour_has_no_pressure(excavator: Bench) -> None:
    effect = excavator.built("pilot_line", "bucket")
    extra, (_, v, _) = excavator.extra("pilot_line", "bucket"), excavator.piston("bucket")
    pressure = excavator.plain[effect.variables()[0]]
    back = v < -5e-3
    assert np.abs(extra[v > 5e-3]).max() < 1e-6
    assert extra[back].max() <= 0.0
    assert spearmanr(extra[back], pressure[back])[0] > 0.99


@pytest.mark.parametrize(
    ("effect", "joint", "why"),
    [
        ("linkage_geometry", "telescope", "telescope has no three-pin linkage"),
        ("linkage_geometry", "slew", "slew has no three-pin linkage"),
        ("encoder_eccentricity", "telescope", "telescope slides; choose a joint that turns"),
        ("hanging_hose", "telescope", "slides"),
    ],
)
def test_what_a_slide_or_a_rack_cannot_have_is_refused(crane: Bench, effect: str, joint: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        check_spec(EffectSpec(effect, joint, 0.01), crane.machine)
