"""Values of a machine file that are possible, hardly true: numbers in other units, slipped decimals, odd proportions.

Every range is wider than what is built, so that a sound file gives no warning: cylinders by ISO 6020, 6022 and
manufacturers' lists (bores 5 to 500 mm, rods of 0.2 to 0.95 of the bore), seals by the speeds they are sold for, arms
by what a person can stand next to. Where another unit would make a number usual, the warning says which.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import ValidationError

from daq.machine.joints import Joint
from daq.machine.machine_file import Machine
from daq.machine.travel import Travel, travel_of
from daq.messages import Sentence
from daq.units import SI_UNITS, conversion, si_unit

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Unusual:
    """A number that is hardly meant: its place in the file, what is odd, and the cure.

    ``slight`` ones change what an identification gives by little or nothing.
    """

    place: Place
    text: str
    cure: str
    slight: bool = False


@dataclass(frozen=True)
class Usual:
    """Usual values of a length or the like, in SI; ``others``: factors to SI of units that people write by mistake."""

    low: float
    high: float
    unit: str
    others: Mapping[str, float]

    def check(self, place: Place, value: float | None, what: str) -> Iterator[Unusual]:
        """Yield a remark if there is a value outside."""
        if value is None or self.low <= (size := abs(value)) <= self.high:
            return
        usual = Sentence(
            "daq.outside_usual", what=what, value=value, unit=self.unit, low=self.low, high=self.high
        ).strip()
        for unit, factor in self.others.items():
            if self.low <= size * factor <= self.high:
                yield Unusual(place, usual, Sentence("daq.if_write", unit=unit, value=value * factor, unit_2=self.unit))
                return
        yield Unusual(place, usual, Sentence("daq.correct_leave_if_right"))


_MM = {"mm": 1e-3, "cm": 1e-2, "inches": 0.0254}
_DEG = {"degrees": np.pi / 180}
_BORE = Usual(0.005, 0.5, "m", _MM)
_STROKE = Usual(0.005, 10.0, "m", _MM)
_PIN = Usual(0.005, 10.0, "m", _MM)
_LINK = Usual(0.0, 20.0, "m", _MM)
_LEVER = Usual(0.003, 2.0, "m", _MM)
_TURN_SPEED = Usual(1e-3, 40.0, "rad/s", _DEG)
_DRIVEN_SPEED = Usual(1e-3, 5.0, "rad/s", _DEG)
_SLIDE_SPEED = Usual(1e-3, 10.0, "m/s", {"mm/s": 1e-3})
_TURN_RATE = Usual(1e-2, 2000.0, "rad/s^2", _DEG)
_SLIDE_RATE = Usual(1e-2, 200.0, "m/s^2", {"mm/s^2": 1e-3})
_PRESSURE = Usual(2e5, 1e8, "Pa", {"bar": 1e5, "MPa": 1e6, "psi": 6894.757})
_FLOW = Usual(1e-6, 0.1, "m^3/s", {"l/min": 1 / 60_000})
_MOST_PISTON_SPEED = 2.0  # m/s: twice what ordinary seals are sold for
_LEAST_STROKE_USE = 0.1
_LEAST_LEVER_SHARE = 0.02  # of the largest: nearer to a dead centre no force is measured
_LEAST_RETRACTED = 0.3  # strokes: a cylinder held at its rod's end may be shorter than its stroke, but not much
_SLIP = 8.0
_SQUARE = 5e-4, 5e-3  # rad: nearer is taken for a quarter turn, farther is meant
_STEEL = 7850.0  # kg/m^3
#: Standard gravity, and that of bodies that machines have been sent to or built for, m/s^2.
_GRAVITIES = {"Earth": 9.81, "the Moon": 1.62, "Mars": 3.71}


def unusual_values(content: Mapping[str, Any]) -> Iterator[Unusual]:
    """Yield remarks on a machine file's content as read from YAML; what is malformed is passed over."""
    yield from _of_the_machine(content)
    joints = content.get("joints")
    for index, joint in enumerate(joints if isinstance(joints, list) else []):
        if isinstance(joint, dict):
            yield from _of_a_joint(("joints", index), joint)
    yield from _among_joints(joints if isinstance(joints, list) else [])
    channels = content.get("channels")
    for index, channel in enumerate(channels if isinstance(channels, list) else []):
        if isinstance(channel, dict):
            yield from _of_a_channel(("channels", index), channel, joints if isinstance(joints, list) else [])


def _at(tree: object, keys: tuple[str, ...]) -> object:
    for key in keys:
        tree = tree.get(key) if isinstance(tree, dict) else None
    return tree


def _number(tree: object, *keys: str) -> float | None:
    found = _at(tree, keys)
    usable = isinstance(found, int | float) and not isinstance(found, bool) and np.isfinite(found)
    return float(found) if usable else None  # type: ignore[arg-type]


def _numbers(count: int, tree: object, *keys: str) -> list[float] | None:
    found = _at(tree, keys)
    if not isinstance(found, list) or len(found) != count:
        return None
    numbers = [_number(entry) for entry in found]
    return None if None in numbers else [entry for entry in numbers if entry is not None]


def _of_the_machine(content: Mapping[str, Any]) -> Iterator[Unusual]:
    rate = _number(content, "rate_hz")
    if rate is not None and rate > 0 and not 5.0 <= rate <= 5000.0:
        yield Unusual(
            ("rate_hz",), Sentence("daq.rate_hz_unusual", rate=rate), Sentence("daq.write_samples_per_second")
        )
    gravity = _numbers(3, content, "gravity")
    if gravity is not None:
        size = float(np.linalg.norm(gravity))
        if size > 0 and not any(abs(size - known) <= 0.01 * known for known in _GRAVITIES.values()):
            yield Unusual(
                ("gravity",),
                Sentence("daq.magnitude_earth", size=size),
                Sentence("daq.write_acceleration_gravity_base"),
            )
    for key, pressure, limit in (("hydraulics", "supply_pressure", "pump_flow"), ("supply", "pressure", "flow_limit")):
        yield from _PRESSURE.check(
            (key, pressure), _number(content, key, pressure), Sentence("daq.what_supply_pressure")
        )
        yield from _FLOW.check((key, limit), _number(content, key, limit), Sentence("daq.what_flow"))


def _of_a_joint(place: Place, joint: Mapping[str, Any]) -> Iterator[Unusual]:
    revolute = joint.get("type", "revolute") == "revolute"
    for key in ("a", "d"):
        yield from _LINK.check((*place, "dh", key), _number(joint, "dh", key), Sentence("daq.what_length"))
    for key in ("alpha", "theta"):
        value = _number(joint, "dh", key)
        yield from _turn((*place, "dh", key), value)
        if value is not None and abs(value) <= 2 * np.pi:
            yield from _angle((*place, "dh", key), value)
    limits = _numbers(2, joint, "limits", "position")
    if limits is not None:
        yield from _limits((*place, "limits", "position"), limits, revolute)
    cylinder = joint.get("cylinder")
    turning = _DRIVEN_SPEED if isinstance(cylinder, dict) else _TURN_SPEED
    for key, usual, what in (
        ("velocity", turning if revolute else _SLIDE_SPEED, Sentence("daq.what_speed")),
        ("acceleration", _TURN_RATE if revolute else _SLIDE_RATE, Sentence("daq.what_acceleration")),
    ):
        if (value := _number(joint, "limits", key)) is not None and value > 0:
            yield from usual.check((*place, "limits", key), value, what)
    if isinstance(cylinder, dict):
        yield from _of_a_cylinder((*place, "cylinder"), cylinder)
        try:
            made = Joint.model_validate(joint)
        except ValidationError:
            return
        yield from _of_its_travel(place, travel_of(made))


def _turn(place: Place, value: float | None) -> Iterator[Unusual]:
    if value is not None and abs(value) > 2 * np.pi:
        cure = Sentence("daq.if_degrees_write_rad", value=np.radians(value))
        yield Unusual(place, Sentence("daq.angle_rad_more_turn", value=value), cure)


def _angle(place: Place, value: float) -> Iterator[Unusual]:
    off = abs(value - np.round(value / (np.pi / 2)) * (np.pi / 2))
    if _SQUARE[0] < off < _SQUARE[1]:
        quarter = float(np.round(value / (np.pi / 2)) * (np.pi / 2))
        yield Unusual(
            place,
            Sentence("daq.rad_quarter_turn_makes", off=f"{off:.1e}"),
            Sentence("daq.write_if_meant", quarter=quarter),
            slight=True,
        )


def _limits(place: Place, limits: Sequence[float], revolute: bool) -> Iterator[Unusual]:
    most, width = max(abs(value) for value in limits), limits[1] - limits[0]
    low, high = limits
    if revolute and most > 2 * np.pi:
        yield Unusual(
            place,
            Sentence("daq.rad_more_turn_side", low=low, high=high),
            Sentence("daq.if_they_degrees_write", low=np.radians(low), high=np.radians(high)),
        )
    elif not revolute and most > 20.0:
        yield Unusual(
            place,
            Sentence("daq.limits_long", low=low, high=high),
            Sentence("daq.if_they_mm_write", low=low / 1000.0, high=high / 1000.0),
        )
    if 0 < width < (0.02 if revolute else 0.002):
        unit = "rad" if revolute else "m"
        yield Unusual(
            place, Sentence("daq.joint_moves", width=width, unit=unit), Sentence("daq.write_whole_range", unit=unit)
        )


def _of_a_cylinder(place: Place, cylinder: Mapping[str, Any]) -> Iterator[Unusual]:
    bore, rod, stroke = (_number(cylinder, key) for key in ("bore", "rod", "stroke"))
    if bore is not None and bore > 0:
        if odd := list(_BORE.check((*place, "bore"), bore, Sentence("daq.what_bore"))):
            yield from odd
            bore = None  # no proportion is judged by it
        elif rod is not None and 0 <= rod < bore and not 0.2 <= rod / bore <= 0.95:
            yield Unusual(
                (*place, "rod"),
                Sentence("daq.rod_bore", rod=rod / bore),
                Sentence("daq.correct_rod_bore_diameters"),
            )
    if stroke is not None and stroke > 0:
        if odd := list(_STROKE.check((*place, "stroke"), stroke, Sentence("daq.what_stroke"))):
            yield from odd
            stroke = None
        elif bore is not None and bore > 0 and not 0.2 <= stroke / bore <= 60:
            yield Unusual(
                (*place, "stroke"),
                Sentence("daq.stroke_bores", stroke=stroke / bore),
                Sentence("daq.correct_stroke_bore"),
            )
    mass = _number(cylinder, "moving_mass")
    if mass is not None and mass > 0 and bore and rod is not None and stroke:
        steel = _STEEL * np.pi / 4 * (rod**2 * 1.2 * stroke + bore**3)
        if not 0.05 <= mass / steel <= 20:
            yield Unusual(
                (*place, "moving_mass"),
                Sentence("daq.kg_times_steel_rod", mass=mass, mass_2=mass / steel),
                Sentence("daq.correct_leave_out_identified"),
            )
    linkage = cylinder.get("linkage")
    if not isinstance(linkage, dict):
        return
    for key in ("a", "b", "retracted", "rod_arm", "coupler_arm", "coupler", "radius"):
        yield from _PIN.check((*place, "linkage", key), _number(linkage, key) or None, Sentence("daq.what_length"))
    for key in ("base_pin", "base_pivot", "rod_pin", "link_pivot", "rocker_pivot", "coupler_pin"):
        point = _numbers(2, linkage, key)
        if point is not None:
            yield from _LINK.check((*place, "linkage", key), max(point, key=abs), Sentence("daq.what_coordinate"))
    for key in ("offset", "angle", "arms_angle", "zero"):
        yield from _turn((*place, "linkage", key), _number(linkage, key))
    retracted = _number(linkage, "retracted")
    if retracted is not None and stroke is not None and 0 < retracted < _LEAST_RETRACTED * stroke:
        yield Unusual(
            (*place, "linkage", "retracted"),
            Sentence("daq.pin_pin_piston_stroke", retracted=retracted, stroke=stroke),
            Sentence("daq.write_distance_pins_piston"),
        )


def _of_its_travel(place: Place, travel: Travel) -> Iterator[Unusual]:
    cylinder, x, r = travel.joint.cylinder, travel.x, travel.r
    if cylinder is None or x is None or r is None:
        return
    used = float(np.ptp(x)) / cylinder.stroke
    if used < _LEAST_STROKE_USE:
        yield Unusual(
            (*place, "limits", "position"),
            Sentence("daq.moves_piston_over_stroke", used=100 * used),
            Sentence("daq.correct_limits_stroke_linkage"),
        )
    if not travel.revolute:
        if cylinder.linkage.type in ("three_pin", "rack"):
            yield Unusual(
                (*place, "cylinder", "linkage"),
                Sentence("daq.linkage_turns_joint_slides", type=cylinder.linkage.type),
                Sentence("daq.use_type_direct"),
            )
        return
    if cylinder.linkage.type == "direct":
        yield Unusual(
            (*place, "cylinder", "linkage"),
            Sentence("daq.direct_cylinder_moves_sliding"),
            Sentence("daq.use_three_pin_pins_four_bar"),
        )
    lever = np.abs(r)
    most = float(lever.max())
    odd = list(_LEVER.check((*place, "cylinder", "linkage"), most, Sentence("daq.what_lever_arm")))
    yield from odd
    least = float(lever.min())
    if not odd and least < _LEAST_LEVER_SHARE * most:
        yield Unusual(
            (*place, "limits", "position"),
            Sentence("daq.comes_near_dead_centre", least=1000.0 * least, most=1000.0 * most),
            Sentence("daq.narrow_limits_correct_linkage"),
        )
    speed = most * travel.joint.limits.velocity
    if speed > _MOST_PISTON_SPEED:
        yield Unusual(
            (*place, "limits", "velocity"),
            Sentence("daq.moves_piston", speed=speed),
            Sentence("daq.correct_rad_linkage_lengths"),
        )


def _among_joints(joints: Sequence[Any]) -> Iterator[Unusual]:
    """Find one bore ten times as large, or as small, as those of all others."""
    bores = {i: b for i, joint in enumerate(joints) if (b := _number(joint, "cylinder", "bore")) and b > 0}
    if len(bores) < 3:
        return
    for index, bore in bores.items():
        others = [other for i, other in bores.items() if i != index]
        factor = bore / float(np.median(others))
        if factor > _SLIP or factor < 1 / _SLIP:
            yield Unusual(
                ("joints", index, "cylinder", "bore"),
                Sentence("daq.times_other_cylinders_bore", bore=bore, factor=factor),
                Sentence("daq.look_slipped_decimal_point"),
            )


def _of_a_channel(place: Place, channel: Mapping[str, Any], joints: Sequence[Any]) -> Iterator[Unusual]:
    quantity, unit, bounds = channel.get("quantity"), channel.get("unit"), _numbers(2, channel, "range")
    if not isinstance(quantity, str) or quantity not in SI_UNITS or not isinstance(unit, str):
        return
    joint = next((j for j in joints if isinstance(j, dict) and j.get("name") == channel.get("joint")), {})
    try:
        there = conversion(unit, si_unit(quantity, straight=joint.get("type") == "prismatic"))
    except ValueError:
        return
    noise = _number(channel, "noise_std")
    if bounds is not None and noise is not None and noise > 0.1 * (bounds[1] - bounds[0]) > 0:
        yield Unusual(
            (*place, "noise_std"),
            Sentence("daq.noise_more_tenth_range", noise=noise, unit=unit),
            Sentence("daq.write_standard_deviation", unit=unit),
        )
    if bounds is None:
        return
    low, high = (float(there.to_si(value)) for value in bounds)
    high_pressure = quantity.endswith("_pressure") and quantity != "tank_pressure"
    if high_pressure and not 5e5 <= high <= 1.5e8:
        yield Unusual(
            (*place, "range"),
            Sentence("daq.ends_bar", high=high / 100000.0),
            Sentence("daq.write_range_correct_unit", unit=unit),
        )
    limits = _numbers(2, joint, "limits", "position")
    if quantity == "joint_position" and limits is not None and limits[0] < limits[1]:
        shared = min(high, limits[1]) - max(low, limits[0])
        if shared < 0.5 * (limits[1] - limits[0]):
            yield Unusual(
                (*place, "range"),
                Sentence("daq.covers_joint_limits_every", shared=100 * max(shared, 0.0) / (limits[1] - limits[0])),
                Sentence("daq.write_range_correct_unit", unit=unit),
            )


def unusual_valves(machine: Machine) -> Iterator[Unusual]:
    """Report what a valid machine file omits of its valves, and what that costs, by joint."""
    for number, joint in enumerate(machine.joints):
        if joint.cylinder is None or joint.cylinder.valve is None:
            continue
        place: Place = ("joints", number, "cylinder", "valve")
        pressures = [machine.channel(f"{side}_pressure", joint.name) for side in ("head", "rod")]
        if machine.channel("command", joint.name) is None:
            yield Unusual(
                place,
                Sentence("daq.no_channel_shows_valve"),
                Sentence("daq.add_channel_quantity_command", joint=joint.name, unit=joint.cylinder.valve.unit),
                slight=True,
            )
        elif not all(pressures):
            yield Unusual(
                place,
                Sentence("daq.without_both_chamber_pressures"),
                Sentence("daq.add_head_pressure_rod_pressure"),
                slight=True,
            )
        elif machine.supplied_at is None and machine.channel("supply_pressure") is None:
            yield Unusual(
                place,
                Sentence("daq.nothing_tells_supply_pressure"),
                "add a supply_pressure channel, or supply: {pressure: ...} in Pa",
                slight=True,
            )
