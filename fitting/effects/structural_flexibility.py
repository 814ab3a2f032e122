from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import SITES, DriveView, Effect, Parameter, Parity, Shape, gap_lever, has_both_positions


class StructuralFlexibility(Effect):
    """A boom that bends under load: the link is not where the encoder at the cylinder shows."""

    id = "structural_flexibility"
    title = "a structure that bends behind the joint"
    level = "joint"
    variable = "cylinder_force"
    over_time = True
    equation = "q_link = q - c tau: c (dY/dq) (-tau) pi / r for all joints"
    parity = Parity.OTHER
    dependence = "follows the load and its derivatives; resonance at 2 to 15 Hz"
    parameters = (Parameter("c", "rad/(N m)", low=0.0),)
    between_sensors = True
    discrete_shapes = frozenset({"about", "friction", "sensor"})
    confounders = ("presliding_hysteresis", "sensor_latency")
    experiment = "a tap test: hit the boom and look for the resonance"
    by_motion = False
    look_at = "the link behind the joint: cracks, loose bolts, a boom that gives way"
    source = "Moberg and Hanssen, flexible manipulators (elastic joint, to first order in the compliance)"
    spreads = True

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns (N, n, 1): what the bending of this joint does to all efforts."""
        if not view.segment.loaded:
            return np.zeros((len(view), len(view.machine.joints), 1))
        return view.body_change(-view.quiet_torque)[:, :, None]

    def gap_shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return shapes along the cylinder or about the joint, with the seals' friction or not."""
        return SITES

    def gap_units(self, shape: Shape) -> tuple[str, ...]:
        """Return a length along the cylinder, an angle about the joint."""
        return ("rad/(N m)",) if shape.get("about", 1.0) else ("m/N",)

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Compute ``h^2 F``: what is beyond the bending lags the piston by ``c F`` along the cylinder (lever h = 1), by
        ``c r F`` about the joint (h = r)."""
        if not has_both_positions(view.machine, view.joint):
            return None
        return (gap_lever(view, shape) ** 2 * view.bending_force(bool(shape.get("friction"))))[:, None]
