from __future__ import annotations

from collections.abc import Sequence

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class PressureGain(Effect):
    """One pressure transducer whose gain is off."""

    id = "pressure_gain"
    title = "a wrong gain of a pressure sensor"
    level = "measurement"
    needs_pressures = True
    variable = "head_pressure"
    equation = "g p1 A1 or -g p2 A2"
    parity = Parity.OTHER
    dependence = "follows one chamber"
    parameters = (Parameter("g", "1", low=-0.3, high=0.3),)
    discrete_shapes = frozenset({"chamber"})
    confounders = ("asymmetric_friction", "load_dependent_friction", "pressure_offset")
    experiment = "a known mass, or both ports joined"
    by_motion = False
    look_at = "the pressure sensor's range and scale in the machine file, then the sensor itself"
    source = "transducer data sheets: span error"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        return ({"chamber": 1.0}, {"chamber": 2.0})

    def signal(self, shape: Shape) -> str:
        """Return the chamber's pressure."""
        return "head_pressure" if shape["chamber"] == 1.0 else "rod_pressure"

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        cylinder, head = view.cylinder, shape["chamber"] == 1.0
        force = view.p1 * cylinder.head_area if head else -view.p2 * cylinder.rod_area
        return force[:, None]
