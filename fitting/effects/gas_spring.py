from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class GasSpring(Effect):
    """A trapped gas volume that one direction of the stroke compresses."""

    id = "gas_spring"
    title = "a gas spring or trapped accumulator"
    level = "cylinder"
    needs_cylinder = True
    variable = "piston_position"
    uses_model = False
    equation = "f_g (1 - x / x_0)^(-n) + f_0, its rest force with a transducer's zero"
    parity = Parity.EVEN
    dependence = "even in v, monotone in x"
    parameters = (Parameter("f_g", "N", low=0.0), Parameter("f_0", "N"))
    shape_units = {"n": "1"}
    discrete_shapes = frozenset({"side", "n"})
    confounders = ("hose_stiffness", "end_cushion", "pressure_offset")
    experiment = "isolate the accumulator"
    by_motion = False
    look_at = "gas in the chamber or an accumulator on the line: bleed the cylinder, check the accumulator"
    source = "polytropic compression of a gas volume"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        return [
            {"side": side, "rest": rest, "n": n} for side in (-1.0, 1.0) for rest in (0.3, 0.6, 1.2) for n in (1.0, 1.4)
        ]

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        low, high = view.range.x
        reach = (1.0 + shape["rest"]) * view.range.span
        return {"x_0": (low + reach if shape["side"] > 0 else high - reach, "m")}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        low, high = view.range.x
        stroke = (view.x - low if shape["side"] > 0 else high - view.x) / view.range.span
        # No recording that was fitted goes beyond 1; where another does, the gas keeps half of what was left there.
        left = 1.0 - np.minimum(stroke, 1.0 + 0.5 * shape["rest"]) / (1.0 + shape["rest"])
        rise = shape["side"] * left ** -shape["n"]
        return np.column_stack([rise, np.ones(len(rise))])

    def plausible(self, values: Sequence[float], stds: Sequence[float]) -> bool:
        """Return whether it rises: else it would be an offset by another name."""
        return values[0] > 3.0 * stds[0]
