"""Flow through the lands of the spools, with its slope over the drop: what the stiff part of the plant is made of.

Arrays are (2, 2, J, P): into and out of the chamber, head and rod chamber, axis, machine. A flow is positive in the
direction of its name (pump to chamber, chamber to tank).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim_backends.arrays import FloatArray
from sim_backends.valve.truth import CylinderOil, ValveTruth

_LAMINAR = 0.02  # drop over the nominal one below which an edge is laminar
_SIDES = (("head_in", "rod_in"), ("head_out", "rod_out"))
#: Sign of the stroke that opens each land, shape (2, 2, 1, 1).
SIGNS = np.array([[1.0, -1.0], [-1.0, 1.0]])[:, :, None, None]


class Lands:
    """The lands of P valve blocks with J valves each."""

    def __init__(self, valves: Sequence[Sequence[ValveTruth]], oils: Sequence[Sequence[CylinderOil]]) -> None:
        def land(key: str) -> FloatArray:
            return np.array(
                [[[[getattr(v.lands[n], key) for v in row] for row in valves] for n in side] for side in _SIDES]
            ).swapaxes(2, 3)

        def valve(key: str) -> FloatArray:
            return np.array([[getattr(v, key) for v in row] for row in valves], dtype=np.float64).T

        self._edge, self._flow, self._exponent = land("edge"), land("flow"), land("exponent")
        self._saturation, self._rounding = land("saturation"), land("rounding")
        self._curved = bool(np.any(self._exponent != 1.0))
        self._levels = bool(np.any(np.isfinite(self._saturation)))
        self._worn = bool(np.any(self._rounding > 0.0))
        self.nominal = valve("nominal_drop")
        shape = self.nominal.shape
        self._limit = np.full((2, 2, *shape), np.inf)  # of meter-out lands: no compensator
        self._limit[0] = valve("compensation")
        self._softness = np.zeros((2, 2, *shape))
        self._softness[0] = valve("softness")
        self._soft = bool(np.any(self._softness > 0.0))
        self._check = np.zeros((2, 2, *shape), dtype=bool)
        self._check[0] = valve("load_check") > 0
        self._cold = valve("cold_flow")
        throttles = [np.array([[getattr(o, key) for o in row] for row in oils]).T for key in ("line_in", "line_out")]
        self._line = np.stack([np.stack([1.0 / t**2] * 2) for t in throttles])  # 1 / conductance^2
        held = np.zeros((2, 2, *shape))
        for p, row in enumerate(oils):
            for j, oil in enumerate(row):
                if oil.counterbalance is not None:
                    held[1, ("head", "rod").index(oil.counterbalance.chamber), j, p] = 1.0 / oil.counterbalance.flow**2
        self._held = held
        self._holds = bool(np.any(held > 0.0))

    def conductance(self, stroke: FloatArray, warmth: FloatArray) -> FloatArray:
        """Compute flows in m^3/s of lands at nominal drop, strokes (J, P), warmth (P,) 0 to 1."""
        over = (SIGNS * stroke - self._edge) / (1.0 - self._edge)
        if self._worn:
            width = np.where(self._rounding > 0.0, self._rounding, 1.0)
            soft = width * np.logaddexp(0.0, over / width)
            over = np.where(self._rounding > 0.0, soft, over)
        over = np.maximum(over, 0.0)
        if self._curved:
            over = over**self._exponent
        if self._levels:
            over = over / np.sqrt(np.sqrt(1.0 + (over / self._saturation) ** 4))
        return self._flow * over * (1.0 - self._cold * (1.0 - warmth))

    def flow(self, conductance: FloatArray, drop: FloatArray, held: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute flows in m^3/s and slopes in m^3/s/Pa at drops in Pa; ``held`` (2, J, P) opens counterbalances.

        ``Q = g d / (d^2 + w^2)^(1/4)`` of ``d = drop / nominal``: ``g sqrt(d)`` but for the laminar beginning. A
        compensator holds the drop over the land at ``m``: ``d / (1 + (d / m)^4)^((1 - softness) / 4)``. Throttles in
        series add as ``1 / g^2``; behind one of them a compensator needs so much more in all.
        """
        squared = conductance**2
        resistance = self._line
        if self._holds:
            opened = np.ones_like(drop)
            opened[1] = np.maximum(held, 1e-4)
            resistance = resistance + self._held / opened**2
        g = conductance / np.sqrt(1.0 + squared * resistance)
        z = np.square(np.square(np.maximum(drop, 0.0) / (self._limit * (1.0 + squared * resistance))))
        if self._soft:
            kept, share = (1.0 + z) ** (0.25 * (self._softness - 1.0)), (1.0 - self._softness) * z / (1.0 + z)
        else:
            kept, share = 1.0 / np.sqrt(np.sqrt(1.0 + z)), z / (1.0 + z)
        d = drop * kept / self.nominal
        squares = d * d + _LAMINAR**2
        root = np.sqrt(np.sqrt(squares))
        flow = g * d / root
        slope = g * (0.5 * d * d + _LAMINAR**2) / (squares * root) * kept * (1.0 - share) / self.nominal
        shut = self._check & (drop < 0.0)
        return np.where(shut, 0.0, flow), np.where(shut, 0.0, slope)
