"""The words for a joint: what a report calls its signals and effects, and in which units, by how the joint is driven.

Inside, every joint is a drive with a position ``x`` and a force, named for the common case, a piston. A person who has
an arm of electric motors reads of joint position and N m. This module is the only place that decides it: effects and
laws are written for a piston, :func:`in_words_of` turns sentences into each joint's own words, and
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
from daq.messages import Sentence
from fitting.regression.drive import effort_unit
from fitting.report.languages import NAMES

#: What signals and texts are called at a joint that is driven directly, and where a rack turns it: a slew motor, of
#: which nothing slides out that could be worn.
MOTOR, SLEW = (NAMES["drives"][drive] for drive in ("motor", "slew"))
#: What becomes of a unit that is written for a piston, at a joint that is turned directly: patterns, one after another.
#: A metre is an angle, but in a torque, in an inertia and of a volume flow.
_TURNING = ((r"(?<!N )(?<!kg )\bm\b(?!\^3/s)", "rad"), (r"\bN\b(?! m\b)", "N m"))
#: The same of a unit that is written for a turning joint, at one that slides.
_SLIDING = ((r"kg m\^2", "kg"), (r"\bN m\b", "N"), (r"\brad\b", "m"), (r"\(N\)", "N"))


@dataclass(frozen=True)
class JointWords:
    """Words of one joint, or of several that are driven alike.

    Attributes
    ----------
    signals : name of a drive's signal to what it is called at this joint
    texts : text of an effect to its text at this joint
    units : patterns in a unit as effects have it, one after another, and what is there at this joint
    """

    signals: Mapping[str, str]
    texts: Mapping[str, str]
    units: tuple[tuple[str, str], ...] = ()

    def signal(self, name: str) -> str:
        """Word ``piston_position`` for this joint."""
        return self.signals.get(name, name)

    def unit(self, unit: str) -> str:
        """Convert ``N/m`` to this joint's unit."""
        for pattern, own in self.units:
            unit = re.sub(pattern, own, unit)
        return unit

    def text(self, text: str) -> str:
        """Word an effect's own text for this joint."""
        for english, own in self.texts.items():
            text = text.replace(english, own)
        return text


_AS_WRITTEN = JointWords({}, {})


def joint_words(joint: Joint) -> JointWords:
    """Return the words for one joint."""
    if joint.cylinder is not None and joint.cylinder.linkage.type == "rack":
        return JointWords(**SLEW)
    if joint.cylinder is not None:
        return JointWords({}, {}, _SLIDING) if joint.type == "prismatic" else _AS_WRITTEN
    return JointWords(**MOTOR, units=_TURNING if joint.type == "revolute" else _SLIDING)


def machine_words(machine: Machine) -> JointWords:
    """Return the words for the whole machine: those of a drive without oil where no joint has a cylinder."""
    if any(joint.cylinder is not None for joint in machine.joints):
        return _AS_WRITTEN
    return JointWords(**MOTOR)


def own_unit(machine: Machine, joint: int | None, unit: str) -> str:
    """Convert an effect's unit to its joint's."""
    return unit if joint is None else joint_words(machine.joints[joint]).unit(unit)


def in_own_units(machine: Machine, entry: dict[str, Any]) -> dict[str, Any]:
    """Convert units of a law's signals and of the missing effort to those of the joints they belong to."""
    joint, curve = entry["joint"], entry["law"]
    if "second" in curve:
        second = curve["second"]
        whose = machine.joint(joint) if second["other"] is None else machine.joints[second["other"]]
        curve = {**curve, "second": {**second, "unit": joint_words(whose).unit(second["unit"])}}
    neighbour, _, _ = entry["variable"].rpartition(".")
    return {
        **entry,
        "law": curve,
        "unit": joint_words(machine.joint(neighbour or joint)).unit(entry["unit"]),
        "effort_unit": effort_unit(machine.joint(joint)),
    }


def in_words_of(machine: Machine, content: Any) -> Any:
    """Convert JSON content: every text in the words of its joint.

    What is in an object with a ``joint`` is about that joint; a text that begins with ``joint2:`` is about joint2;
    in ``joint3.piston_speed`` the signal is joint3's. Keys are kept: they are the report's contract.
    """
    words = {joint.name: joint_words(joint) for joint in machine.joints}
    if not any(own.signals or own.texts for own in words.values()):
        return content
    return _Speaker(words, machine_words(machine)).converted(content, None)


@dataclass(frozen=True)
class _Speaker:
    words: Mapping[str, JointWords]
    whole: JointWords

    def converted(self, content: Any, about: JointWords | None) -> Any:
        """Convert for joint ``about``, None while none was named."""
        if isinstance(content, Mapping):
            joint = content.get("joint")
            own = self.words.get(joint, about) if isinstance(joint, str) else about
            return {name: self.converted(entry, own) for name, entry in content.items()}
        if isinstance(content, (list, tuple)):
            return [self.converted(entry, about) for entry in content]
        if isinstance(content, Sentence):
            own = self.words.get(content.partition(":")[0], about)
            return content.mapped(lambda value: self.converted(value, own))
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
    """Compile a drive's signal in a text, with the neighbour's joint in front, outside file names."""
    names = "|".join(re.escape(joint) for joint in sorted(joints, key=len, reverse=True))
    signals = "|".join(MOTOR["signals"])
    return re.compile(rf"(?<![\w./\\-])(?:(?P<joint>{names})\.)?(?P<name>{signals})(?!\w|\.\w)")
