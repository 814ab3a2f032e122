from __future__ import annotations

from collections.abc import Sequence

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape


class VelocityRootFriction(Effect):
    """A friction curve with another power of the speed than the base model's cube root."""

    id = "velocity_root_friction"
    title = "power-law friction"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "b |v|^n sgn v"
    parity = Parity.ODD
    dependence = "odd in v"
    parameters = (Parameter("b", "N (s/m)^n", low=0.0),)
    shape_units = {"n": "1"}
    discrete_shapes = frozenset({"n"})
    confounders = ("stribeck", "quadratic_loss")
    experiment = "a staircase of constant speeds"
    look_at = "nothing is broken: this seal has another friction curve than the base model"
    source = "observed on a Staubli TX40: n = 1/2"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        return [{"n": n} for n in (0.15, 0.5, 0.7, 1.5)]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        return view.power(shape["n"])[:, None]
