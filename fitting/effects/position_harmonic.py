from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PositionHarmonic(Effect):
    """A force that is periodic in position: a screw, a gear, a rod surface."""

    id = "position_harmonic"
    title = "a force that is periodic in position"
    level = "cylinder"
    variable = "piston_position"
    uses_model = False
    equation = "a sin(2 pi (x - x_m) / pitch) + b cos(2 pi (x - x_m) / pitch), also times sgn v"
    parity = Parity.OTHER
    dependence = "periodic in x"
    parameters = (Parameter("a", "N"), Parameter("b", "N"))
    shape_units = {"pitch": "m"}
    discrete_shapes = frozenset({"odd"})
    confounders = ("encoder_eccentricity", "supply_ripple")
    experiment = "change the speed: a harmonic stays in x, a ripple in t"
    look_at = "screw, gear or rod surface: count its teeth or its pitch against the period that was found"
    source = "EMPS benchmark: 2.5 mm harmonic of the screw"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        # Fewer than three periods over the stroke are no periodicity that data could show.
        cycles = np.arange(3.25, 40.0, 0.75)
        return [{"pitch": view.range.span / c, "odd": odd} for c in cycles.tolist() for odd in (0.0, 1.0)]

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        return {"x_m": (view.range.middle, "m")}

    def overtone(self, shape: Shape) -> Shape | None:
        """Return half of the pitch: no wave is a pure sine."""
        return {**shape, "pitch": 0.5 * shape["pitch"]}

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        key = f"harmonic {shape['pitch']}"  # shared by the even and the odd one
        if key not in view.cache:
            phase = 2 * np.pi * (view.x - view.range.middle) / shape["pitch"]
            view.cache[key] = np.column_stack([np.sin(phase), np.cos(phase)])
        waves = view.cache[key]
        return waves * view.s[:, None] if shape["odd"] else waves
