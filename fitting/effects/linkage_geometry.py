from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daq.machine.linkages import Linkage, Polynomial, reduced
from daq.machine.machine_file import Machine
from fitting.arm.linkage import (
    cylinder_of,
    lever_arm_derivatives,
    parameter_derivatives,
    parameter_names,
    with_parameter,
)
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Shape, has_both_positions
from fitting.signals.corrections import Corrections


class LinkageGeometry(Effect):
    """A pin that is not where the machine file has it: the lever arm is wrong."""

    id = "linkage_geometry"
    title = "a linkage pin that is not where the machine file says"
    level = "joint"
    variable = "joint_position"
    series = True
    equation = "-F_l d ln r / d p"
    parity = Parity.OTHER
    dependence = "multiplies the load by a function of q"
    parameters = (
        Parameter("shift", "m or rad", low=-0.1, high=0.1),
        Parameter("turn", "rad", low=-0.1, high=0.1),
        Parameter("zero", "m", low=-0.1, high=0.1),
    )
    discrete_shapes = frozenset({"parameter", "turn", "zero"})
    confounders = ("encoder_offset", "load_dependent_friction")
    includes = ("encoder_offset",)
    experiment = "compare piston position and joint angle over the whole stroke"
    look_at = "the lengths of the linkage in the machine file against the drawing, and worn or wrongly set pins"
    source = "derivative of F_l = tau / r with respect to a pin coordinate"

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether the linkage has parameters."""
        cylinder = machine.joints[joint].cylinder
        return cylinder is not None and len(parameter_names(cylinder.linkage)) > 0

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return one parameter of the linkage, alone or with what a displaced pin changes too.

        A pin moves in a plane: its distance from the axis changes (``parameter``, its number), and its bearing
        (``turn``: 1). The piston's sensor may have been zeroed before or after (``zero``: 1; only where both positions
        are measured). ``parameter`` is -1 where the distance is right.
        """
        names = parameter_names(reduced(view.cylinder.linkage))
        beside = [("turn", "offset"), ("zero", "retracted")]
        seen = has_both_positions(view.machine, view.joint)
        free = [key for key, name in beside if name in names and (seen or key == "turn")]
        alone = [float(k) for k, name in enumerate(names) if name not in dict(beside).values()]
        grid = [{"parameter": k, "turn": t, "zero": z} for k in (-1.0, *alone) for t in (0.0, 1.0) for z in (0.0, 1.0)]
        return [
            shape
            for shape in grid
            if (shape["parameter"] >= 0) + shape["turn"] + shape["zero"] > 0
            and (shape["parameter"] >= 0 or shape["turn"] + shape["zero"] < 2)
            and all(key in free for key in ("turn", "zero") if shape[key])
        ]

    def gap_shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return the same, but no bearing alone: between position sensors that is an encoder's offset."""
        return [shape for shape in self.shapes(view) if shape["parameter"] >= 0 or shape["zero"]]

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        linkage = reduced(view.cylinder.linkage)
        if not view.segment.loaded:
            return np.zeros((len(view), 3))
        return -view.load[:, None] * _chosen(linkage, lever_arm_derivatives(linkage, view.q), shape) / view.r[:, None]

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Return ``dx/dp``: the piston is at the true linkage's x(q), the model at the file's."""
        linkage = reduced(view.cylinder.linkage)
        return _chosen(linkage, parameter_derivatives(linkage, view.q), shape)

    def apply_to_signals(
        self, corrections: Corrections, joint: str, shape: Shape, values: Sequence[float]
    ) -> Corrections:
        """Correct the machine's linkage to the finding."""
        machine = corrections.machine
        number = next(n for n, each in enumerate(machine.joints) if each.name == joint)
        cylinder = cylinder_of(machine.joints[number])
        linkage = _changed(reduced(cylinder.linkage), shape, values)
        joints = list(machine.joints)
        own = cylinder.model_copy(update={"linkage": linkage})
        joints[number] = joints[number].model_copy(update={"cylinder": own})
        return replace(corrections, machine=machine.model_copy(update={"joints": tuple(joints)}))

    def gap_change(self, view: DriveView, shape: Shape, values: Sequence[float]) -> FloatArray | None:
        """Compute the same for a displacement of any size."""
        linkage = reduced(view.cylinder.linkage)
        return _changed(linkage, shape, values).piston_position(view.q) - linkage.piston_position(view.q)


def _changed(linkage: Linkage, shape: Shape, values: Sequence[float]) -> Linkage:
    """Change the linkage's parameters by ``values``, as :class:`LinkageGeometry` names them."""
    for number, value in zip(_numbers(linkage, shape), values, strict=True):
        if number is None or not value:
            continue
        if isinstance(linkage, Polynomial):
            coefficients = list(linkage.coefficients)
            coefficients[number] += value
            linkage = linkage.model_copy(update={"coefficients": tuple(coefficients)})
        else:
            name = parameter_names(linkage)[number]
            linkage = with_parameter(linkage, name, getattr(linkage, name) + value)
    return linkage


def _numbers(linkage: Linkage, shape: Shape) -> tuple[int | None, int | None, int | None]:
    """Return the numbers of the linkage's parameters of the three values; None for unchanged ones."""
    names = parameter_names(linkage)
    number = int(shape["parameter"])
    turn, zero = (
        names.index(name) if shape.get(key) else None for key, name in (("turn", "offset"), ("zero", "retracted"))
    )
    return number if number >= 0 else None, turn, zero


def _chosen(linkage: Linkage, derivatives: FloatArray, shape: Shape) -> FloatArray:
    """Return derivatives (N, 3) by the three values; zero for unchanged ones."""
    columns = np.zeros((len(derivatives), 3))
    for place, number in enumerate(_numbers(linkage, shape)):
        if number is not None:
            columns[:, place] = derivatives[:, number]
    return columns
