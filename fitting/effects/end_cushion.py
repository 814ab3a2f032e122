from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class EndCushion(Effect):
    """A cushion that throttles the oil near one end of the stroke."""

    id = "end_cushion"
    title = "an end-of-stroke cushion"
    level = "cylinder"
    needs_cylinder = True
    variable = "piston_position"
    uses_model = False
    equation = "w^n (k + d v), w = distance inside the cushion, which begins at x_c"
    parity = Parity.OTHER
    dependence = "even and odd parts, only near one end"
    parameters = (Parameter("k", "N/m^n", low=0.0), Parameter("d", "N s/m^(n+1)", low=0.0))
    shape_units = {"n": "1"}
    discrete_shapes = frozenset({"side", "n"})
    confounders = ("linkage_geometry", "hose_stiffness", "gas_spring")
    experiment = "dwell inside the cushion"
    look_at = "the cushion at that end of the cylinder: its screw and its seal"
    source = "ISO 10100 (cylinders, cushioning)"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        return [
            {"side": side, "share": share, "n": n}
            for side in (-1.0, 1.0)
            for share in (0.08, 0.15, 0.25)
            for n in (1.0, 2.0)
        ]

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        low, high = _stroke(view)
        depth = shape["share"] * (high - low)
        return {"x_c": (high - depth if shape["side"] > 0 else low + depth, "m")}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        low, high = _stroke(view)
        depth = shape["share"] * (high - low)
        inside = np.maximum(0.0, view.x - (high - depth) if shape["side"] > 0 else (low + depth) - view.x)
        weight = inside ** shape["n"]
        return np.column_stack([shape["side"] * weight, weight * view.v])


def _stroke(view: DriveView) -> tuple[float, float]:
    """Return ends of the allowed or reached stroke, m: a cushion is there, wherever recordings were."""
    (low, high), limits = view.range.x, view.machine.joints[view.joint].limits.position
    ends = np.clip(view.cylinder.linkage.piston_position(np.array(limits)), 0.0, view.cylinder.stroke)
    return min(low, float(np.min(ends))), max(high, float(np.max(ends)))
