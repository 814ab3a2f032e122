"""Chambers of the cylinders and the pump: capacities, leaks, relief, friction, and the slopes that make them stiff.

Arrays are (2, J, P) for chambers (head, rod), (J, P) for cylinders, (P,) for pumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.valve.truth import CylinderOil, OilTruth, SupplyTruth, ValveTruth

REVERSAL_SPEED = 2.0e-4  # m/s: half-width of the smoothed Coulomb jump
END_YIELD = 1.0e-3  # m that an end stop gives at 300 bar
END_TIME = 5.0e-3  # s: damping of an end stop over its stiffness
MAKE_UP = 3.0e5  # Pa below tank at which the anti-cavitation valves let half a full stroke's flow through
RELIEVING = 1.0e6  # Pa above the setting at which port relief valves let half a full stroke's flow out
GAP_LAMINAR = 2.0e5  # Pa
SPILL = 0.2  # of the pump's full flow that goes back where pressure is above the wanted one


class Chambers:
    """The cylinders of P machines with J axes each."""

    def __init__(
        self,
        machines: Sequence[Machine],
        oils: Sequence[Sequence[CylinderOil]],
        valves: Sequence[Sequence[ValveTruth]],
        fluids: Sequence[OilTruth],
        supplies: Sequence[SupplyTruth],
    ) -> None:
        def stacked(key: str) -> FloatArray:
            return np.array([[getattr(oil, key) for oil in row] for row in oils], dtype=np.float64).T

        cylinders = [[joint.cylinder for joint in machine.joints] for machine in machines]
        area = np.array([[[c.head_area, -c.rod_area] for c in row if c is not None] for row in cylinders])
        self.area = np.ascontiguousarray(area.transpose(2, 1, 0))  # m^2 with the sign of the force: A1, -A2
        self.stroke = np.array([[c.stroke for c in row if c is not None] for row in cylinders]).T
        self.bulk = np.array([fluid.bulk_modulus for fluid in fluids])
        self.tank = np.array([supply.tank for supply in supplies])
        at_retracted = np.stack([stacked("head_dead"), stacked("rod_dead") + -self.area[1] * self.stroke])
        self._capacity = at_retracted / self.bulk + np.stack([stacked("head_hose"), stacked("rod_hose")])
        self._growth = self.area / self.bulk
        self.mass, self.spring = stacked("mass"), stacked("spring")
        damping = np.array([[c.damping for c in row if c is not None] for row in cylinders]).T
        self._coulomb, self._viscous = stacked("f_c"), stacked("f_v") + damping
        self._end = self.area[0] * 3.0e7 / END_YIELD
        self._to_tank = np.stack([stacked("head_leak"), stacked("rod_leak")])
        # A load-holding valve stands between the spool's gap and its chamber.
        free = [[[o.counterbalance is None or o.counterbalance.chamber != k for o in row] for row in oils]
                for k in ("head", "rod")]  # fmt: skip
        clearance = np.array([[valve.clearance for valve in row] for row in valves])
        self._clearance = (clearance * np.array(free)).swapaxes(1, 2)
        self._across, self._gap = stacked("piston_leak"), stacked("piston_gap")
        self._gaps = bool(np.any(self._gap > 0.0))
        full = np.array([[max(land.flow for land in valve.lands.values()) for valve in row] for row in valves]).T
        self._full, self._relief = full, stacked("relief")

    def capacity(self, x: FloatArray) -> FloatArray:
        """Compute ``V(x) / E + hose`` in m^3/Pa at piston positions (J, P)."""
        return np.asarray(np.maximum(self._capacity + self._growth * x, 0.02 * self._capacity))

    def losses(self, p: FloatArray, stroke: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute what leaves each chamber other than through a land, and slopes.

        Returns
        -------
        out : (2, J, P) m^3/s, leaving: leaks to tank, past the piston, over relief; make-up counts negative
        own : (2, J, P) m^3/s/Pa, slope over the chamber's own pressure
        across : (J, P) m^3/s/Pa, slope over the difference of both, already in ``own``
        """
        to_tank = self._to_tank + self._clearance * (np.abs(stroke) < 0.02)
        above = p - self.tank
        made_up, eager = _check_valve(-above / MAKE_UP)
        relieved, opening = _check_valve((p - self._relief) / RELIEVING)
        own = to_tank + self._full * (eager / MAKE_UP + opening / RELIEVING)
        out = to_tank * above + self._full * (relieved - made_up)
        difference, across = p[0] - p[1], self._across
        past = across * difference
        if self._gaps:
            squares = difference**2 + GAP_LAMINAR**2
            root = np.sqrt(np.sqrt(squares))
            past = past + self._gap * difference / root
            across = across + self._gap * (0.5 * difference**2 + GAP_LAMINAR**2) / (squares * root)
        out[0] += past
        out[1] -= past
        return out, own + across, across

    def resistance(self, x: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compute friction, spring, end stops: force (J, P) in N against extension; its slopes over ``v``, ``x``."""
        ratio = np.tanh(v / REVERSAL_SPEED)
        beyond = np.minimum(x, 0.0) + np.maximum(x - self.stroke, 0.0)
        end = self._end * (beyond != 0.0)
        force = self._coulomb * ratio + (self._viscous + END_TIME * end) * v + self.spring * x + self._end * beyond
        over_v = self._coulomb * (1.0 - ratio**2) / REVERSAL_SPEED + self._viscous + END_TIME * end
        return force, over_v, self.spring + end


def _check_valve(s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Model a valve that opens softly, ``s^2 / (1 + s)`` above 0, and its slope."""
    s = np.maximum(s, 0.0)
    return s * s / (1.0 + s), s * (2.0 + s) / (1.0 + s) ** 2


class Pumps:
    """The pumps of P machines."""

    def __init__(self, supplies: Sequence[SupplyTruth], fluids: Sequence[OilTruth]) -> None:
        def stacked(key: str) -> FloatArray:
            return np.array([getattr(supply, key) for supply in supplies], dtype=np.float64)

        self.capacity = stacked("volume") / np.array([fluid.bulk_modulus for fluid in fluids])
        self.pressure, self.margin, self.standby = stacked("pressure"), stacked("margin"), stacked("standby")
        self.sensing = np.array([supply.kind == "load_sensing" for supply in supplies])
        self.lag = stacked("lag")
        self._full, self._gain = stacked("full_flow"), stacked("full_flow") / stacked("droop")
        self._flow_limit, self._power_limit = stacked("flow_limit"), stacked("power_limit")

    def wanted(self, p: FloatArray, active: npt.NDArray[np.bool_]) -> FloatArray:
        """Compute the pump's target pressure (P,) in Pa, with chambers at ``p`` of which ``active`` are filling."""
        load = np.where(active, p, 0.0).max(axis=(0, 1))
        return np.where(self.sensing, np.clip(load + self.margin, self.standby, self.pressure), self.pressure)

    def flow(self, supply: FloatArray, aim: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute flow in m^3/s at a supply pressure, and its fall with that pressure in m^3/s/Pa, each (P,)."""
        limit = np.minimum(self._flow_limit, self._power_limit / np.maximum(supply, 1.0e5))
        asked = self._gain * (aim - supply)
        low = -SPILL * self._full
        return np.clip(asked, low, limit), self._gain * ((asked > low) & (asked < limit))
