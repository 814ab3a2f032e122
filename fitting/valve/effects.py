"""Effects of the level "valve": what a command's way to a speed may have beyond edges, gains, delay and pressure law.

Each is one object with the hooks of :class:`ValveEffect`: it changes the command, the delay, the factor of an
opening, or adds columns. ``starts`` are the shapes from which a search begins anew: an optimum that
was found without the effect has bent the edges and the delay, and leads nowhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from fitting.arrays import BoolArray, FloatArray
from fitting.valve.laws import Bounds, root

if TYPE_CHECKING:
    from fitting.valve.rows import Axis, Signals

Shape = Mapping[str, float]
#: K: oil at 40 degrees Celsius, where gains are given if its temperature is measured.
REFERENCE = 313.15
#: Pressure drops (N,) at inlet and outlet of the direction, over their references.
Drops = tuple[FloatArray, FloatArray]


class ValveEffect:
    """Base of the effects; every hook leaves things as they are."""

    id: ClassVar[str]
    title: ClassVar[str]
    level: ClassVar[str] = "valve"
    equation: ClassVar[str]
    #: Numbers that are searched, by names that begin with the effect's own: start, least, largest.
    shape: ClassVar[Mapping[str, Bounds]] = {}
    units: ClassVar[Mapping[str, str]] = {}
    starts: ClassVar[Sequence[Shape]] = ({},)
    confounders: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str]
    look_at: ClassVar[str]
    source: ClassVar[str]

    def applies(self, axis: Axis) -> bool:
        """Return whether measured channels could show it."""
        return True

    def command(self, u: FloatArray, shape: Shape) -> FloatArray:
        """Return the command (N,) that the spool follows."""
        return u

    def delay(self, way: int, shape: Shape) -> tuple[float, float]:
        """Return the addition to a direction's delay, s, and the spool's lag in it."""
        return 0.0, 0.0

    def factor(self, own: FloatArray, way: str, axis: Axis, drops: Drops, shape: Shape) -> FloatArray:
        """Return an opening's factor (N,), 1 at the reference.

        Parameters
        ----------
        own : (N,) the factor without this effect
        way : ``extend`` or ``retract``
        axis : what was recorded
        drops : (N,) each, at inlet and outlet of the direction, over their references
        shape : numbers that are searched
        """
        return own

    def columns(self, signals: Signals, share: FloatArray, areas: tuple[float, float]) -> dict[str, FloatArray]:
        """Return further linear columns (N,); ``share`` is the head's balance in the speed."""
        return {}


class Hysteresis(ValveEffect):
    """The spool keeps its place until the command has gone a little way: friction, and the solenoid's remanence."""

    id = "spool_hysteresis"
    title = "hysteresis of the spool"
    equation = "spool = play(u, h): |spool - u| <= h"
    shape: ClassVar = {"spool_hysteresis.width": (0.01, 0.0, 0.15)}
    units: ClassVar = {"spool_hysteresis.width": "of full command, either side"}
    starts = ({"spool_hysteresis.width": 0.008}, {"spool_hysteresis.width": 0.03})
    confounders = ("delay_per_direction",)
    experiment = "the ladder of small steps around each edge, up and down, at two speeds"
    look_at = "dither of the amplifier, dirt in the spool, the solenoid"
    source = "Merritt 1967, 10-5"

    def command(self, u: FloatArray, shape: Shape) -> FloatArray:
        width, spool, out = shape["spool_hysteresis.width"], float(u[0]), []
        for own in u.tolist():
            if own - width > spool:
                spool = own - width
            elif own + width < spool:
                spool = own + width
            out.append(spool)
        return np.array(out)


class DelayPerDirection(ValveEffect):
    """One direction answers later: one solenoid of two, a longer hose, a load-holding valve that opens late."""

    id = "delay_per_direction"
    title = "another delay in each direction"
    equation = "T_extend = T + d, T_retract = T - d, tau_extend = tau + l, tau_retract = tau - l"
    shape: ClassVar = {f"delay_per_direction.{name}": (0.0, -0.25, 0.25) for name in ("half", "lag")}
    units: ClassVar = dict.fromkeys(shape, "s")
    starts = tuple(
        {"delay_per_direction.half": half, "delay_per_direction.lag": lag}
        for half, lag in ((0.06, 0.0), (-0.06, 0.0), (0.06, 0.06), (-0.06, -0.06))
    )
    confounders = ("spool_hysteresis",)
    experiment = "steps of both signs from rest"
    look_at = "the two solenoids, and a counterbalance valve"
    source = "measured"

    def delay(self, way: int, shape: Shape) -> tuple[float, float]:
        half, lag = (shape[f"delay_per_direction.{name}"] for name in ("half", "lag"))
        return (half, lag) if way == 0 else (-half, -lag)


class WarmUp(ValveEffect):
    """Speeds grow as the oil gets warm (or fall, of a laminar metering edge)."""

    id = "warm_up"
    title = "speeds that change as the oil gets warm"
    equation = "g (1 + a (theta - theta_0) / 10 K), or without a sensor g (1 + a exp(-t / tau))"
    shape: ClassVar = {"warm_up.share": (-0.05, -0.6, 0.6), "warm_up.tau": (30.0, 3.0, 600.0)}
    units: ClassVar = {
        "warm_up.share": "per 10 K, or at the beginning",
        "warm_up.tau": "s, of no meaning with a sensor",
    }
    starts = (
        {"warm_up.share": -0.1, "warm_up.tau": 15.0},
        {"warm_up.share": -0.1, "warm_up.tau": 120.0},
        {"warm_up.share": 0.1, "warm_up.tau": 60.0},
    )
    experiment = "the same cycle cold and warm, with the oil's temperature"
    look_at = "oil temperature and viscosity grade"
    source = "Merritt 1967, 3-3"

    def factor(self, own: FloatArray, way: str, axis: Axis, drops: Drops, shape: Shape) -> FloatArray:
        signals = axis.signals
        if signals.warm:
            return own * np.maximum(1.0 + shape["warm_up.share"] * (signals.temperature - REFERENCE) / 10.0, 0.05)
        return own * (1.0 + shape["warm_up.share"] * np.exp(-signals.clock / shape["warm_up.tau"]))


class OverrunningLoad(ValveEffect):
    """A load that pulls is held by the oil that leaves: there the outlet's edge decides, not the inlet's."""

    id = "overrunning_load"
    title = "the outlet's edge decides where the load pulls"
    equation = "f = r sqrt(d_out / d_out0) where (p_head A1 - p_rod A2) is along the motion"
    shape: ClassVar = {f"overrunning_load.{way}": (1.0, 0.05, 10.0) for way in ("extend", "retract")}
    units: ClassVar = dict.fromkeys(shape, "of the inlet's edge, at the reference drops")
    starts = tuple({"overrunning_load.extend": r, "overrunning_load.retract": r} for r in (0.7, 1.3))
    confounders = ("undeclared_orifice",)
    experiment = "the same speeds with the load pulling and pushing"
    look_at = "counterbalance and throttle-check valves, the outlet edges of the spool"
    source = "Merritt 1967, 5-6"

    def applies(self, axis: Axis) -> bool:
        if not axis.has_pressures:
            return False
        pulling = [_pulls(axis, way) & (sign * axis.signals.u > 0) for way, sign in _SIGNS.items()]
        return bool(np.any(pulling))

    def factor(self, own: FloatArray, way: str, axis: Axis, drops: Drops, shape: Shape) -> FloatArray:
        pulls = _pulls(axis, way)
        return np.where(pulls, shape[f"overrunning_load.{way}"] * root(drops[1]), own)


_SIGNS = {"extend": 1.0, "retract": -1.0}


def _pulls(axis: Axis, way: str) -> BoolArray:
    """Return where (N,) the load is along a direction's motion."""
    force = axis.signals.inlet[0] * axis.areas[0] - axis.signals.inlet[1] * axis.areas[1]
    return np.asarray(_SIGNS[way] * force < 0.0)


class UndeclaredOrifice(ValveEffect):
    """A valve that is declared compensated and is not, or whose compensator is stuck."""

    id = "undeclared_orifice"
    title = "an orifice where the machine file says compensated"
    equation = "f = sqrt((p_s - p_in) / d_0)"
    confounders = ("overrunning_load",)
    experiment = "the same command at two loads"
    look_at = "the compensator, and compensated: of the machine file"
    source = "Merritt 1967, 5-3"

    def applies(self, axis: Axis) -> bool:
        return axis.has_supply and axis.valve.compensated is True

    def factor(self, own: FloatArray, way: str, axis: Axis, drops: Drops, shape: Shape) -> FloatArray:
        return root(drops[0])


class PistonLeak(ValveEffect):
    """Oil that passes the piston's seal, in proportion to the pressure across it."""

    id = "piston_leak"
    title = "a leak past the piston"
    equation = "Q = c (p_head - p_rod)"
    confounders = ("port_leak",)
    experiment = "rest with the valve closed at a loaded pose: the head's pressure falls and the rod's rises"
    look_at = "the piston's seal"
    source = "Merritt 1967, 5-4"

    def applies(self, axis: Axis) -> bool:
        return axis.has_pressures

    def columns(self, signals: Signals, share: FloatArray, areas: tuple[float, float]) -> dict[str, FloatArray]:
        across = signals.inlet[0] - signals.inlet[1]
        return {"piston_leak": -across * (share / areas[0] + (1.0 - share) / areas[1])}


class PortLeak(ValveEffect):
    """Oil that leaves a port to the tank, of each its own: the spool's leak, a relief valve that does not close."""

    id = "port_leak"
    title = "a leak from the ports to the tank"
    equation = "Q_i = c_i (p_i - p_tank)"
    confounders = ("piston_leak",)
    experiment = "rest with the valve closed at a loaded pose: both pressures fall, and the load sinks"
    look_at = "the spool, relief and anti-cavitation valves"
    source = "Merritt 1967, 5-4"

    def applies(self, axis: Axis) -> bool:
        return axis.has_pressures

    def columns(self, signals: Signals, share: FloatArray, areas: tuple[float, float]) -> dict[str, FloatArray]:
        head, rod = (own - signals.tank for own in signals.inlet)
        return {"port_leak.head": -share * head / areas[0], "port_leak.rod": (1.0 - share) * rod / areas[1]}


EFFECTS: dict[str, ValveEffect] = {
    effect.id: effect
    for effect in (
        Hysteresis(),
        DelayPerDirection(),
        WarmUp(),
        OverrunningLoad(),
        UndeclaredOrifice(),
        PistonLeak(),
        PortLeak(),
    )
}
