"""Laws of one measured variable: what is reported when no known effect fits.

A law is a cubic spline in one signal of the joint itself or of a neighbour, alone or times the sign of the joint's
speed, fitted together with the base. It localises structure without knowing its physics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, has_pressures
from fitting.effects.variables import NEIGHBOUR, OWN, parallel_joints, values_of
from fitting.residual.views import Views
from fitting.signals.splines import evaluate, spline_knots

#: The joint's own force, which is what is to be predicted.
OWN_FORCE = "cylinder_force"
#: Basis functions of a spline law of the joint's own signals, and of others'.
OWN_FUNCTIONS, OTHER_FUNCTIONS = 16, 8
#: Own signals whose laws may be gone when the arm is off: what bears its weight.
GONE_UNLOADED = ("piston_position", "link_angle", "cylinder_force")
#: Neighbours' signals that act through the arm, and so not where it is off; oil and hoses are there all the same.
THROUGH_THE_ARM = ("joint_position", "cylinder_force", "link_angle")
#: Signals that are the model's own, not measured.
OF_THE_MODEL = ("cylinder_force", "force_rate", "head_pressure", "rod_pressure")
_PRESSURES = ("head_pressure", "rod_pressure")
#: Neighbours' signals whose laws may act in one direction of motion only: those that open and close this joint's
#: valves. What the joint's own do one way is friction that differs between the directions, or a load-holding valve.
ONE_WAY = ("cylinder_force", "head_pressure", "rod_pressure", "joint_position")
Way = Literal["", "positive", "negative"]
#: Directions of motion in which a law may act alone, as signs of the speed.
WAYS: dict[Way, float] = {"positive": 1.0, "negative": -1.0}


@dataclass(frozen=True)
class Law:
    """A spline law on one joint.

    Attributes
    ----------
    signal : name of the signal
    other : the neighbour's number, or None for the joint's own signal
    signed : True if the law is multiplied by the sign of the joint's own speed
    loaded_only : True if it is gone when unloaded
    knots : knots of the spline, in the signal's unit
    only : ``positive`` or ``negative`` if it acts while the joint's own speed has that sign only, as behind a valve
    """

    signal: str
    other: int | None
    signed: bool
    loaded_only: bool
    knots: tuple[float, ...]
    only: Way = ""

    def values(self, view: DriveView) -> FloatArray:
        """Return the signal, (N,)."""
        return values_of(view, self.signal, self.other)

    @property
    def unit(self) -> str:
        """Unit of the signal."""
        return OWN[self.signal][0] if self.other is None else NEIGHBOUR[self.signal][0]

    @property
    def functions(self) -> int:
        """Number of its columns."""
        return len(self.knots) - 4

    @property
    def signals(self) -> tuple[tuple[str, int | None], ...]:
        """The signals that it is a law of, each with its neighbour's number."""
        return ((self.signal, self.other),)

    @property
    def uses_model(self) -> bool:
        """True where the signal is the model's, not measured."""
        return self.signal in OF_THE_MODEL

    def variable(self, joints: tuple[str, ...]) -> str:
        """Return the report's name: own ``piston_position``, ``joint3.cylinder_force`` of a neighbour."""
        return self.signal if self.other is None else f"{joints[self.other]}.{self.signal}"

    def columns(self, view: DriveView) -> FloatArray:
        """Return columns (N, functions)."""
        key = f"{self.signal}/{self.other}/{hash(self.knots)}"  # shared by signed, unsigned and loaded-only laws
        if key not in view.cache:
            view.cache[key] = evaluate(np.asarray(self.knots), self.values(view))
        basis = view.cache[key]
        return self.acting(basis, view)

    def acting(self, basis: FloatArray, view: DriveView) -> FloatArray:
        """Return its functions (N, k) with sign and extent by the direction of motion and the load."""
        if self.loaded_only and not view.segment.loaded:
            return np.zeros_like(basis)
        return np.asarray(basis * self.factor(view.s)[:, None] if self.signed or self.only else basis)

    def factor(self, direction: Any) -> Any:
        """Return the factor of its functions at a direction of motion, -1 to 1."""
        if self.signed:
            return direction
        return 0.5 * (1.0 + WAYS[self.only] * direction) if self.only else 1.0

    @property
    def parity(self) -> tuple[bool, Way]:
        """Dependence on the direction of motion: two laws of one signal that differ in it add up."""
        return self.signed, self.only


def laws(views: Views, joint: int, fitted: tuple[int, ...]) -> Iterator[Law]:
    """List all laws of a joint that these recordings can show."""
    machine = views[0][joint].machine
    for signal, (_, own) in OWN.items():
        if signal in _PRESSURES and not has_pressures(machine, joint):
            continue
        if signal == "oil_temperature" and any(views[i][joint].segment.temperature is None for i in fitted):
            continue
        if signal == "force_rate":
            continue  # what follows it is a delay, and what noise makes of a force's rate follows everything else
        if signal == "link_angle" and len(parallel_joints(machine, joint)) == 1:
            continue  # the joint's own angle
        if signal == "total_flow" and not any(j.cylinder is not None for j in machine.joints):
            continue
        values = np.concatenate([own(views[i][joint]) for i in fitted])
        for loaded_only in (False, True) if signal in GONE_UNLOADED else (False,):
            # Without the sign of speed, a law of the own force would predict the effort from itself.
            signs = (True,) if signal == OWN_FORCE else (False, True)
            yield from _family(values, signal, None, loaded_only, signs)
    for other in range(len(machine.joints)):
        if other == joint:
            continue
        for signal, (_, getter) in NEIGHBOUR.items():
            if signal == "link_angle" and len(parallel_joints(machine, other)) == 1:
                continue
            if signal in _PRESSURES and not has_pressures(machine, other):
                continue
            loaded_only = signal in THROUGH_THE_ARM
            values = np.concatenate(
                [getter(views[i][joint], other) for i in fitted if views[i][joint].segment.loaded or not loaded_only]
                or [np.zeros(1)]
            )
            yield from _family(values, signal, other, loaded_only)


def _family(
    values: FloatArray, signal: str, other: int | None, loaded_only: bool, signs: tuple[bool, ...] = (False, True)
) -> Iterator[Law]:
    if not varies(values):
        return
    functions = OWN_FUNCTIONS if other is None else OTHER_FUNCTIONS
    knots = tuple(spline_knots(values, functions).tolist())
    for signed in signs:
        yield Law(signal, other, signed, loaded_only, knots)
    if other is not None and signal in ONE_WAY:
        for way in WAYS:
            yield Law(signal, other, False, loaded_only, knots, way)


def varies(values: FloatArray) -> bool:
    """Return whether values (N,) are known and more than one, so that there may be a law of them."""
    return bool(np.isfinite(values).all() and np.ptp(values) > 1e-9 * max(float(np.abs(values).max()), 1e-300))
