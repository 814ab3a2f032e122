"""The words for a joint: what a report calls its signals and effects, and in which units, by how the joint is driven.

Inside, every joint is a drive with a position ``x`` and a force, named for the common case, a piston. A person who has
an arm of electric motors is told of joint position and N m. This module is the only place that decides it: effects and
laws are written for a piston, :func:`in_words_of` turns what is said into each joint's own words, and
:meth:`JointWords.unit` its units.

A joint that is driven directly turns (rad, N m) or slides (m, N). A sliding joint has metres and newtons whatever
drives it, also for effects of the joint that are written for a turning one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from daq.machine.machine_file import Joint, Machine
from fitting.regression.drive import effort_unit

#: Signals of a drive as programs write them, at a joint that is driven directly.
_SIGNALS = {
    "piston_position": "joint_position",
    "piston_speed": "joint_speed",
    "piston_acceleration": "joint_acceleration",
    "cylinder_force": "joint_effort",
    "force_rate": "effort_rate",
}
#: What effects say of themselves, and what causes are, where a joint has neither piston nor oil, in its own words.
_TEXTS = {
    "friction that depends on the piston position": "friction that depends on the joint position",
    "friction that differs between extending and retracting": "friction that differs between the two directions",
    "a flow loss that grows with the square of the speed": "a drag that grows with the square of the speed",
    "viscous friction that drifts as the oil warms up": "viscous friction that drifts as the drive warms up",
    "a drifting pressure sensor": "a drifting effort sensor",
    "an offset of a pressure sensor": "an offset of the effort sensor",
    "a force that is periodic in position": "an effort that is periodic in position",
    "vent both chambers and read the sensors": "take the load off and read the sensor",
    "an offset is also there at rest: hold the arm still at both ends of a stroke": (
        "an offset is also there at rest: hold the arm still at both ends of its range"
    ),
    "compare joint and piston encoder over the whole stroke; no dynamics needed": (
        "compare with a second encoder over the whole range; no dynamics needed"
    ),
    "a pressure gauge at the cylinder port during fast strokes": "fast motions",
    "the same stroke with two loads": "the same motion with two loads",
    "a staircase of constant speeds below 5 mm/s": "a staircase of slow constant speeds",
    "creeps over its stroke": "creeps over its range",
    "on the other side of gear or cylinder": "on the other side of the gear",
    "rod and piston seals of the cylinder, and the zero of its two pressure sensors": (
        "gear and bearings of the joint, and the zero of its effort sensor"
    ),
    "pins, bushings and gear between piston and joint": "bearings, coupling and gear between motor and joint",
    "seals and bearings of the cylinder and its pins: lubrication": "gear and bearings of the joint: lubrication",
    "seals and guide of the cylinder, and the oil's viscosity": (
        "gear and bearings of the joint, and the viscosity of their grease"
    ),
    "bore, rod and guide of the cylinder where friction is high: a worn rod, a bore that is not round": (
        "gear and guide of the joint where friction is high: wear, or parts that are not round"
    ),
    "screw, gear or rod surface: count": "screw or gear: count",
    "seals of the cylinder: their preload": "gear and bearings of the joint: their preload",
    "seals of the cylinder that chamber pressure presses: type and wear": "gear and bearings of the joint: wear",
    "the pressure sensor and its temperature": "the effort sensor and its temperature",
    "the pressure sensor's range and scale": "the effort sensor's range and scale",
    "the pressure sensor's zero: vent both chambers and set it": (
        "the effort sensor's zero: take the load off and set it"
    ),
    "port, fittings and hose between pressure sensor and chamber: a throttle, or a sensor far from the port": (
        "gear and bearings of the joint: what grows with the square of the speed, as stirred grease"
    ),
    "seals and lubrication of the cylinder at low speed": "gear and bearings of the joint: lubrication at low speed",
    "the oil: warm the machine up before recordings, or add an oil temperature sensor": (
        "the grease: warm the machine up before recordings"
    ),
}
#: The same where a rack turns the joint: a slew motor, of which nothing slides out that could be worn.
_SLEWING = {
    "rod and piston seals of the cylinder, and the zero of its two pressure sensors": (
        "seals and bearings of the slew motor, and the zero of its two pressure sensors"
    ),
    "pins, bushings and gear between piston and joint": "pinion, gear and bearings between slew motor and joint",
    "seals and bearings of the cylinder and its pins: lubrication": "gear and bearings of the slew motor: lubrication",
    "seals and guide of the cylinder, and the oil's viscosity": "seals of the slew motor, and the oil's viscosity",
    "bore, rod and guide of the cylinder where friction is high: a worn rod, a bore that is not round": (
        "slew motor, gear and slewing ring where friction is high: wear, or parts that are not round"
    ),
    "screw, gear or rod surface: count": "slew motor or gear: count",
    "seals of the cylinder: their preload": "gear and bearings of the slew motor: their preload",
    "seals of the cylinder that chamber pressure presses: type and wear": (
        "seals of the slew motor that its pressure presses: type and wear"
    ),
    "seals and lubrication of the cylinder at low speed": "gear and bearings of the slew motor at low speed",
    "the cushion at that end of the cylinder: its screw and its seal": "the cushion at that end of the slew motor",
    "bleed the cylinder, check the accumulator": "bleed the slew motor, check the accumulator",
}
#: Units that are written for a piston, at a joint that is turned directly.
_TURNING = {
    "m": "rad",
    "m/s": "rad/s",
    "m/s^2": "rad/s^2",
    "N": "N m",
    "N/s": "N m/s",
    "N/m": "N m/rad",
    "N/m^2": "N m/rad^2",
    "N/m^3": "N m/rad^3",
    "N/m^4": "N m/rad^4",
    "N/m^5": "N m/rad^5",
    "N/rad": "N m/rad",
    "N s/m": "N m s/rad",
    "N s^2/m^2": "N m s^2/rad^2",
    "N (s/m)^n": "N m (s/rad)^n",
}
#: Units that are written for a turning joint, at one that slides.
_SLIDING = {
    "rad": "m",
    "rad/s": "m/s",
    "N m": "N",
    "N m/rad": "N/m",
    "N m/rad^2": "N/m^2",
    "N m/rad^3": "N/m^3",
    "N m/rad^4": "N/m^4",
    "N m/rad^5": "N/m^5",
    "kg m^2": "kg",
    "rad/(N m)": "m/N",
}


@dataclass(frozen=True)
class JointWords:
    """Words of one joint, or of several that are driven alike.

    Attributes
    ----------
    signals : name of a drive's signal to what it is called at this joint
    texts : what an effect says to what it says at this joint
    units : unit as effects have it to that of this joint
    """

    signals: Mapping[str, str]
    texts: Mapping[str, str]
    units: Mapping[str, str]

    def signal(self, name: str) -> str:
        """``piston_position`` as this joint has it."""
        return self.signals.get(name, name)

    def unit(self, unit: str) -> str:
        """``N/m`` as this joint has it."""
        return self.units.get(unit, unit)

    def text(self, text: str) -> str:
        """What an effect says of itself, for this joint."""
        for said, own in self.texts.items():
            text = text.replace(said, own)
        return text


_AS_WRITTEN = JointWords({}, {}, {})


def joint_words(joint: Joint) -> JointWords:
    """The words for one joint."""
    if joint.cylinder is not None and joint.cylinder.linkage.type == "rack":
        return JointWords({}, _SLEWING, {})
    if joint.cylinder is not None:
        return JointWords({}, {}, _SLIDING) if joint.type == "prismatic" else _AS_WRITTEN
    return JointWords(_SIGNALS, _TEXTS, _TURNING if joint.type == "revolute" else _SLIDING)


def machine_words(machine: Machine) -> JointWords:
    """The words for what concerns the whole machine: those of a drive without oil where no joint has a cylinder."""
    if any(joint.cylinder is not None for joint in machine.joints):
        return _AS_WRITTEN
    return JointWords(_SIGNALS, _TEXTS, {})


def own_unit(machine: Machine, joint: int | None, unit: str) -> str:
    """A unit of an effect as the joint has it that the effect is at."""
    return unit if joint is None else joint_words(machine.joints[joint]).unit(unit)


def in_own_units(machine: Machine, entry: dict[str, Any]) -> dict[str, Any]:
    """A law with its signals' units and that of the missing effort, as the joints have them that they belong to."""
    joint, curve = entry["joint"], entry["law"]
    if "second" in curve:
        second = curve["second"]
        whose = machine.joint(joint) if second["other"] is None else machine.joints[second["other"]]
        curve = {**curve, "second": {**second, "unit": joint_words(whose).unit(second["unit"])}}
    return {
        **entry,
        "law": curve,
        "unit": _variable_unit(machine, entry["variable"], joint, entry["unit"]),
        "effort_unit": effort_unit(machine.joint(joint)),
    }


def _variable_unit(machine: Machine, variable: str, joint: str, unit: str) -> str:
    """Unit of a signal: of the joint itself, or of the neighbour that ``variable`` begins with."""
    neighbour, _, _ = variable.rpartition(".")
    return joint_words(machine.joint(neighbour or joint)).unit(unit)


def in_words_of(machine: Machine, content: Any) -> Any:
    """The same JSON content with every text in the words of the joint that it is about.

    What stands in an object with a ``joint`` is about that joint; a text that begins with ``joint2:`` is about joint2;
    in ``joint3.piston_speed`` the signal is joint3's. Keys stay: they are the report's contract.
    """
    words = {joint.name: joint_words(joint) for joint in machine.joints}
    if not any(own.signals or own.texts for own in words.values()):
        return content
    return _Speaker(words, machine_words(machine)).said(content, None)


@dataclass(frozen=True)
class _Speaker:
    words: Mapping[str, JointWords]
    whole: JointWords

    def said(self, content: Any, about: JointWords | None) -> Any:
        """``about`` is the joint's, None where nothing said so yet."""
        if isinstance(content, Mapping):
            joint = content.get("joint")
            own = self.words.get(joint, about) if isinstance(joint, str) else about
            return {name: self.said(entry, own) for name, entry in content.items()}
        if isinstance(content, (list, tuple)):
            return [self.said(entry, about) for entry in content]
        return self._text(content, about) if isinstance(content, str) else content

    def _text(self, text: str, about: JointWords | None) -> str:
        first = text.partition(":")[0]
        own = self.words.get(first) or about or self.whole

        def signal(found: re.Match[str]) -> str:
            other = self.words.get(found["joint"] or "")
            return f"{found['joint']}.{other.signal(found['name'])}" if other else own.signal(found["name"])

        return own.text(_pattern(tuple(self.words)).sub(signal, text))


@cache
def _pattern(joints: tuple[str, ...]) -> re.Pattern[str]:
    """A drive's signal in a text, with the joint in front where it is a neighbour's; no part of a file's name."""
    names = "|".join(re.escape(joint) for joint in sorted(joints, key=len, reverse=True))
    signals = "|".join(_SIGNALS)
    return re.compile(rf"(?<![\w./\\-])(?:(?P<joint>{names})\.)?(?P<name>{signals})(?!\w|\.\w)")
