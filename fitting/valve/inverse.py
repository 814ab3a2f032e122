"""From a wanted speed to the command that gives it.

With the reference drops ``d_0`` and the law ``f`` of a direction ``i``::

    v = wanted + Kp (s_ref - s)
    u = sign(v) (e_i + (|v| / (k_i f_i(d)))^(1 / c_i))      0 below lo, on again above hi = 3 lo

A command outside what was recorded is clipped there, and flagged; a number that is none gives 0 and a flag. Pressures
may be measured ones or those that the identified mechanics predict; without them the reference drops are taken.

Flags are bits: 1 clipped at the largest recorded command, 2 an input was no number, 4 pressures were missing or no drop
was left and the reference was taken.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from daq.errors import InputError
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit
from fitting.valve.laws import LAWS
from fitting.valve.model import WAYS, free_curve

CLIPPED, NO_NUMBER, NO_PRESSURE = 1, 2, 4
#: Share of the speed at full command below which a standing axis stays at rest; three times that sets it moving.
REST_SHARE = 0.005
#: Of the reference drop: less is not believed.
LEAST_SHARE = 0.02
#: Of a free curve's table.
POINTS = 33


@dataclass(frozen=True)
class Direction:
    """One direction of a valve's model.

    Attributes
    ----------
    edge : share of full command where it begins to move
    gain : m/s per full command to the power of ``power``
    power : exponent of the curve
    openings, speeds : points of a free curve, m/s over what is beyond the edge, both rising from 0; empty for a power
    law : of the pressure (:data:`fitting.valve.laws.LAWS`)
    law_shape : its numbers
    drop_in, drop_out : Pa, reference drops at which the gain is given
    largest : largest recorded command, share of full
    """

    edge: float
    gain: float
    power: float
    openings: tuple[float, ...]
    speeds: tuple[float, ...]
    law: str
    law_shape: Mapping[str, float]
    drop_in: float
    drop_out: float
    largest: float

    def speed(self, opening: float) -> float:
        """m/s at the reference drops of what is beyond the edge."""
        if self.openings:
            return float(np.interp(opening, self.openings, self.speeds))
        return float(self.gain * max(opening, 0.0) ** self.power)

    def opening(self, speed: float) -> float:
        """What has to be beyond the edge for a speed at the reference drops, m/s; beyond a free curve its end."""
        if self.openings:
            return float(np.interp(speed, self.speeds, self.openings))
        return float((speed / self.gain) ** (1.0 / self.power)) if self.gain > 0 else np.inf

    @property
    def fastest(self) -> float:
        """m/s at the largest recorded command and the reference drops."""
        return self.speed(self.largest - self.edge)

    def factor(self, inlet: float, outlet: float) -> float:
        """What pressure drops, Pa, make of the gain."""
        law = LAWS[self.law]
        drops = np.array([self.drop_in, self.drop_out])
        pair = np.array([inlet / self.drop_in]), np.array([outlet / self.drop_out])
        return float(law.factor(*pair, drops, self.law_shape)[0])


@dataclass(frozen=True)
class Command:
    """An answer of the inverse: the command as it is to be sent, its share of full, and flags (see the module)."""

    command: float
    share: float
    flags: int


@dataclass(frozen=True)
class ValveModel:
    """A valve's model as it is handed out: all that the inverse and its exports need.

    Attributes
    ----------
    joint : name
    unit, neutral, full, extends : of the command, as the machine file has them
    least, most : ends of the amplifier's range
    delay : s, for a preview of the reference
    directions : extend, retract
    areas : m^2 of head and rod
    pump_limit : m^3/s, identified or declared; None where nobody knows
    left_out : effects that were found and that the inverse does not undo
    error : on the other motion, RMS over that of the speed; None without one
    """

    joint: str
    unit: str
    neutral: float
    full: float
    extends: int
    least: float
    most: float
    delay: float
    directions: tuple[Direction, Direction]
    areas: tuple[float, float]
    pump_limit: float | None
    left_out: tuple[str, ...]
    error: float | None

    @property
    def moves(self) -> bool:
        """Whether it was seen to move its axis in some direction."""
        return any(own.fastest > 0 for own in self.directions)

    @property
    def asks(self) -> tuple[str, ...]:
        """Pressures that its laws are made of: where one of them is not known, the reference is taken for all."""
        needs = {LAWS[own.law].needs for own in self.directions} - {"nothing"}
        chambers = ("head", "rod") if needs else ()
        return (*chambers, *(("supply",) if "supply" in needs else ()), *(("tank",) if "outlet" in needs else ()))

    def command(
        self,
        speed: float,
        *,
        moving: bool = True,
        head: float = np.nan,
        rod: float = np.nan,
        supply: float = np.nan,
        tank: float = 0.0,
    ) -> Command:
        """The command for a speed of the rod.

        Parameters
        ----------
        speed : m/s, positive extends
        moving : whether the last command was not at rest: the hysteresis of standing still
        head, rod, supply, tank : Pa; NaN takes the reference drops
        """
        if not np.isfinite(speed):
            return Command(self.neutral, 0.0, NO_NUMBER)
        way = 0 if speed > 0 else 1
        own, sign = self.directions[way], (1.0 if speed > 0 else -1.0)
        low = REST_SHARE * own.fastest
        if abs(speed) < (low if moving else 3.0 * low) or own.fastest <= 0.0:
            return Command(self.neutral, 0.0, 0)
        factor, flags = self._factor(own, way, head, rod, supply, tank)
        beyond = own.opening(abs(speed) / factor)
        share = own.edge + beyond
        if share > own.largest or abs(speed) / factor > own.fastest * (1.0 + 1e-9):
            share, flags = own.largest, flags | CLIPPED
        raw = self.neutral + self.extends * sign * share * self.full
        command = min(max(raw, self.least), self.most)
        return Command(command, sign * share, flags | (CLIPPED if command != raw else 0))

    def _factor(
        self, own: Direction, way: int, head: float, rod: float, supply: float, tank: float
    ) -> tuple[float, int]:
        needs = LAWS[own.law].needs
        if needs == "nothing":
            return 1.0, 0
        given = {"head": head, "rod": rod, "supply": supply, "tank": tank}
        if not all(np.isfinite(given[name]) for name in self.asks):
            return 1.0, NO_PRESSURE
        filled, emptied = (head, rod) if way == 0 else (rod, head)
        drops = supply - filled, emptied - tank
        asked = drops[0] if needs == "supply" else drops[1]
        reference = own.drop_in if needs == "supply" else own.drop_out
        if asked < LEAST_SHARE * reference:
            return 1.0, NO_PRESSURE
        return own.factor(drops[0] if needs == "supply" else 0.0, drops[1] if needs == "outlet" else 0.0), 0

    def scale(self, speeds: Mapping[str, float], models: Mapping[str, ValveModel]) -> float:
        """By what all wanted speeds are to be multiplied, so that the pump can give them: ``min(1, Q / sum A |v|)``."""
        if self.pump_limit is None:
            return 1.0
        asked = sum(models[name].areas[0 if v > 0 else 1] * abs(v) for name, v in speeds.items())
        return min(1.0, self.pump_limit / asked) if asked > 0 else 1.0

    def to_json(self) -> dict[str, Any]:
        """As plain content; :meth:`from_json` reads it back."""
        content: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return content | {"schema": "hilfit/valve-model/1"}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> ValveModel:
        """A model from :meth:`to_json`'s content (InputError if it is none)."""
        if content.get("schema") != "hilfit/valve-model/1":
            raise InputError("not a valve's model: schema is not hilfit/valve-model/1; give model of a valve report")
        own = {key: value for key, value in content.items() if key != "schema"}
        own["directions"] = tuple(
            Direction(**{**d, "openings": tuple(d["openings"]), "speeds": tuple(d["speeds"])})
            for d in own["directions"]
        )
        own["areas"], own["left_out"] = tuple(own["areas"]), tuple(own["left_out"])
        return cls(**own)


#: Effects that are in the inverse, or that it needs not undo: a delay is for whoever looks ahead.
_HARMLESS = ("delay_per_direction", "undeclared_orifice")


def direction_of(fit: Fit, way: int) -> Direction:
    """One direction of what a fit hands out."""
    axis, shape, name = fit.axis, fit.shape, WAYS[way]
    law = "meter_in" if "undeclared_orifice" in fit.structure.effects else fit.structure.laws[way]
    edge, largest = shape[f"edge.{name}"], axis.largest[way]
    openings, speeds = tuple[float, ...](), tuple[float, ...]()
    if fit.structure.curve == "monotone":
        reach = max(largest - edge, 1e-6)
        ends = reach * np.linspace(0.0, 1.0, POINTS) ** 2  # dense where small speeds are
        parts = free_curve(ends, shape[f"power.{name}"], reach)
        curve = sum(fit.gains[f"gain.{name}.{j}"] * part for j, part in enumerate(parts))
        openings, speeds = tuple(ends.tolist()), tuple(np.maximum.accumulate(curve).tolist())
    return Direction(
        edge=edge,
        gain=fit.gains.get(f"gain.{name}", 0.0),
        power=1.0 if openings else shape.get(f"power.{name}", 1.0),
        openings=openings,
        speeds=speeds,
        law=law,
        law_shape={key: shape[f"{key}.{name}"] for key in LAWS[law].shape},
        drop_in=float(axis.drops[way, 0]),
        drop_out=float(axis.drops[way, 1]),
        largest=largest,
    )


def model_of(fit: Fit, *, error: float | None, pump_limit: float | None) -> ValveModel:
    """What a fit hands out."""
    axis, shape = fit.axis, fit.shape
    valve = axis.valve
    return ValveModel(
        joint=axis.joint.name,
        unit=valve.unit,
        neutral=valve.neutral,
        full=valve.full,
        extends=valve.extends,
        least=valve.range[0],
        most=valve.range[1],
        delay=shape["delay"],
        directions=(direction_of(fit, 0), direction_of(fit, 1)),
        areas=axis.areas,
        pump_limit=pump_limit,
        left_out=tuple(EFFECTS[own].title for own in fit.structure.effects if own not in _HARMLESS),
        error=error,
    )
