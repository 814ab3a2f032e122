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
from fitting.model.export.tracing.graph import Curve, Graph, Node
from fitting.signals.splines import free_curve
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit
from fitting.valve.laws import LAWS
from fitting.valve.model import WAYS

CLIPPED, NO_NUMBER, NO_PRESSURE = 1, 2, 4
#: Share of the speed at full command below which a standing axis remains at rest; three times that sets it moving.
REST_SHARE = 0.005
#: Of the reference drop: less is not trusted.
LEAST_SHARE = 0.02
#: What is given, in this order: m/s, Pa (of whatever is not known any number, with ``known`` 0), 1 and 0.
GIVEN = ("speed", "head", "rod", "supply", "tank", "known", "moving")
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
        """Compute the speed, m/s at the reference drops, of what is beyond the edge."""
        if self.openings:
            return float(np.interp(opening, self.openings, self.speeds))
        return float(self.gain * max(opening, 0.0) ** self.power)

    def opening(self, speed: float) -> float:
        """Compute the opening beyond the edge for a speed at the reference drops, m/s; past a free curve its end."""
        return float(_opening(Graph(), self, speed)) if self.openings or self.gain > 0 else np.inf

    @property
    def fastest(self) -> float:
        """m/s at the largest recorded command and the reference drops."""
        return self.speed(self.largest - self.edge)


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
        """True where it was seen to move its axis in some direction."""
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
        """Compute the command for a speed of the rod.

        Parameters
        ----------
        speed : m/s, positive extends
        moving : whether the last command was not at rest: the hysteresis of rest
        head, rod, supply, tank : Pa; NaN takes the reference drops
        """
        if not np.isfinite(speed):
            return Command(self.neutral, 0.0, NO_NUMBER)
        pressures = {"head": head, "rod": rod, "supply": supply, "tank": tank}
        known = all(np.isfinite(pressures[name]) for name in self.asks)
        measured = {name: value if known and name in self.asks else 0.0 for name, value in pressures.items()}
        found = inverse_graph(self, {"speed": speed, "known": known, "moving": moving, **measured})
        return Command(float(found["command"]), float(found["share"]), int(float(found["flags"])))

    def scale(self, speeds: Mapping[str, float], models: Mapping[str, ValveModel]) -> float:
        """Compute the factor of all wanted speeds within the pump's flow: ``min(1, Q / sum A |v|)``."""
        if self.pump_limit is None:
            return 1.0
        asked = sum(models[name].areas[0 if v > 0 else 1] * abs(v) for name, v in speeds.items())
        return min(1.0, self.pump_limit / asked) if asked > 0 else 1.0

    def to_json(self) -> dict[str, Any]:
        """Return plain content; :meth:`from_json` reads it back."""
        content: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return content | {"schema": "hilfit/valve-model/1"}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> ValveModel:
        """Read a model from :meth:`to_json`'s content (InputError if it is none)."""
        if content.get("schema") != "hilfit/valve-model/1":
            raise InputError("fitting.not_a_valve_model")
        own = {key: value for key, value in content.items() if key != "schema"}
        own["directions"] = tuple(
            Direction(**{**d, "openings": tuple(d["openings"]), "speeds": tuple(d["speeds"])})
            for d in own["directions"]
        )
        own["areas"], own["left_out"] = tuple(own["areas"]), tuple(own["left_out"])
        return cls(**own)


def inverse_graph(model: ValveModel, numbers: Mapping[str, float] | None = None) -> dict[str, Node]:
    """Build nodes ``command`` (as sent), its ``share`` of full, ``flags`` and ``going`` (moving or not).

    They are of variables :data:`GIVEN`, or of ``numbers`` in their place, and numbers then.
    """
    graph = Graph()
    given = {name: graph.variable(name) if numbers is None else graph.number(numbers[name]) for name in GIVEN}
    speed, moving = given["speed"], given["moving"]
    zero = graph.number(0.0)
    share, flags, going = zero, zero, zero
    for way, own in enumerate(model.directions):
        if own.fastest <= 0.0:
            continue
        sign = 1.0 if way == 0 else -1.0
        wanted = graph.binary("max", speed * sign, 0.0)
        low = REST_SHARE * own.fastest
        here = graph.binary("at_least", wanted, low * (3.0 - 2.0 * moving))
        factor, missing = _factor(graph, own, way, given)
        reduced = wanted / factor
        asked = own.edge + _opening(graph, own, reduced)
        beyond = graph.binary(
            "max",
            graph.binary("above", asked, own.largest),
            graph.binary("above", reduced, own.fastest * (1.0 + 1e-9)),
        )
        clipped = beyond * own.largest + (1.0 - beyond) * graph.binary("min", asked, own.largest)
        share = share + here * clipped * sign
        flags = flags + here * (CLIPPED * beyond + NO_PRESSURE * missing)
        going = going + here
    raw = model.neutral + model.extends * model.full * share
    command = graph.binary("min", graph.binary("max", raw, model.least), model.most)
    outside = graph.binary("above", graph.unary("abs", raw - command), 0.0)
    return {"command": command, "share": share, "flags": graph.binary("max", flags, CLIPPED * outside), "going": going}


def _factor(graph: Graph, own: Direction, way: int, given: Mapping[str, Node]) -> tuple[Node, Node]:
    """Return the pressures' factor of the gain, and 1 where the reference replaces them."""
    needs = LAWS[own.law].needs
    if needs == "nothing":
        return graph.number(1.0), graph.number(0.0)
    filled, emptied = (given["head"], given["rod"]) if way == 0 else (given["rod"], given["head"])
    drop = given["supply"] - filled if needs == "supply" else emptied - given["tank"]
    reference = own.drop_in if needs == "supply" else own.drop_out
    trusted = graph.binary("at_least", drop, LEAST_SHARE * reference) * given["known"]
    ratio = graph.binary("max", drop, LEAST_SHARE * reference) / reference
    if own.law == "free_exponent":
        factor = graph.binary("power", ratio, own.law_shape["exponent"])
    elif own.law == "compensated":
        order, whole = own.law_shape["order"], (reference / own.law_shape["margin"]) ** own.law_shape["order"]
        share = graph.binary("power", ratio, order) * whole
        factor = graph.binary("power", share / (1.0 + share) * ((1.0 + whole) / whole), 0.5 / order)
    else:
        factor = graph.unary("sqrt", ratio)
    return trusted * factor + (1.0 - trusted), 1.0 - trusted


def _opening(graph: Graph, own: Direction, speed: Node | float) -> Node:
    """Return the opening beyond the edge for a speed at the reference drops."""
    if not own.openings:
        line = graph.of(speed) / own.gain
        return line if own.power == 1.0 else graph.binary("power", graph.binary("max", line, 1e-12), 1.0 / own.power)
    speeds, openings = np.array(own.speeds), np.array(own.openings)
    rising = np.append(True, np.diff(speeds) > 0.0)  # a flat piece has no inverse; what is before it is enough
    speeds, openings = speeds[rising], openings[rising]
    slopes = np.diff(openings) / np.diff(speeds)
    nothing = np.zeros_like(slopes)
    return graph.curve(speed, Curve(speeds, np.column_stack([nothing, nothing, slopes, openings[:-1]])))


#: Effects that are in the inverse, or that it needs not undo: a delay is for whoever looks forward.
_HARMLESS = ("delay_per_direction", "undeclared_orifice")


def direction_of(fit: Fit, way: int) -> Direction:
    """Return one direction of a fit's model."""
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
    """Return a fit's model."""
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
