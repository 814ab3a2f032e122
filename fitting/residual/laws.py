"""Laws of one measured variable: what is said when no known effect fits.

A law is a cubic spline in one signal of the joint itself or of a neighbour, alone or times the sign of the joint's
speed, fitted together with the base. It localises structure without knowing its physics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.effects.base import DriveView, has_pressures
from fitting.residual.views import Views
from fitting.splines import evaluate, spline_knots

FloatArray = npt.NDArray[np.float64]

#: signal name -> (unit, getter)
OWN: dict[str, tuple[str, Callable[[DriveView], FloatArray]]] = {
    "piston_position": ("m", lambda view: view.x),
    "piston_speed": ("m/s", lambda view: view.v),
    "piston_acceleration": ("m/s^2", lambda view: view.a),
    "cylinder_force": ("N", lambda view: view.force),
    "head_pressure": ("Pa", lambda view: view.p1),
    "rod_pressure": ("Pa", lambda view: view.p2),
    "time": ("s", lambda view: view.clock),
    "time_since_reversal": ("s", lambda view: _since_reversal(view)),
    "oil_temperature": ("K", lambda view: _temperature(view)),
}
NEIGHBOUR: dict[str, tuple[str, Callable[[DriveView, int], FloatArray]]] = {
    "joint_position": ("rad", lambda view, other: view.segment.q[:, other]),
    "piston_speed": ("m/s", lambda view, other: view.segment.v[:, other]),
    "cylinder_force": ("N", lambda view, other: view.forces[:, other]),
}
#: The joint's own force, which is what is to be predicted.
OWN_FORCE = "cylinder_force"
#: Basis functions of the splines: smooth laws of every signal, bumpier ones of the joint's own.
SMOOTH, FINE, FINEST = 4, 8, 16
_LOCAL = ("piston_position",)
#: Deviations of the speed's noise above which its sign is sure.
_SURE = 3.0


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
    """

    signal: str
    other: int | None
    signed: bool
    loaded_only: bool
    knots: tuple[float, ...]

    def values(self, view: DriveView) -> FloatArray:
        """The signal, (N,)."""
        return OWN[self.signal][1](view) if self.other is None else NEIGHBOUR[self.signal][1](view, self.other)

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
        return self.signal in ("cylinder_force", "head_pressure", "rod_pressure")

    def variable(self, joints: tuple[str, ...]) -> str:
        """Name in the report: ``piston_position`` of the joint itself, ``joint3.cylinder_force`` of a neighbour."""
        return self.signal if self.other is None else f"{joints[self.other]}.{self.signal}"

    def columns(self, view: DriveView) -> FloatArray:
        """Columns (N, functions)."""
        key = f"{self.signal}/{self.other}/{hash(self.knots)}"  # shared by signed, unsigned and loaded-only laws
        if key not in view.cache:
            view.cache[key] = evaluate(np.asarray(self.knots), self.values(view))
        basis = view.cache[key]
        if self.signed:
            basis = basis * view.s[:, None]
        return np.zeros_like(basis) if self.loaded_only and not view.segment.loaded else basis


def laws(views: Views, joint: int, fitted: tuple[int, ...]) -> Iterator[Law]:
    """All laws of a joint that these recordings can show."""
    machine = views[0][joint].machine
    for signal in OWN:
        if signal in ("head_pressure", "rod_pressure") and not has_pressures(machine, joint):
            continue
        if signal == "oil_temperature" and any(views[i][joint].segment.temperature is None for i in fitted):
            continue
        values = np.concatenate([OWN[signal][1](views[i][joint]) for i in fitted])
        for loaded_only in (False, True) if signal in ("piston_position", "cylinder_force") else (False,):
            functions = (SMOOTH, FINE, FINEST) if signal in _LOCAL else (SMOOTH, FINE)
            # Without the sign of speed, a law of the own force would predict the effort from itself.
            signs = (True,) if signal == OWN_FORCE else (False, True)
            yield from _family(values, signal, None, loaded_only, functions, signs)
    for other in range(len(machine.joints)):
        if other == joint:
            continue
        for signal, (_, getter) in NEIGHBOUR.items():
            loaded_only = signal != "piston_speed"
            values = np.concatenate(
                [getter(views[i][joint], other) for i in fitted if views[i][joint].segment.loaded or not loaded_only]
                or [np.zeros(1)]
            )
            yield from _family(values, signal, other, loaded_only, (SMOOTH,))


def _family(
    values: FloatArray,
    signal: str,
    other: int | None,
    loaded_only: bool,
    functions: tuple[int, ...],
    signs: tuple[bool, ...] = (False, True),
) -> Iterator[Law]:
    if not np.all(np.isfinite(values)) or np.ptp(values) <= 1e-9 * max(float(np.max(np.abs(values))), 1e-300):
        return
    for count in functions:
        knots = tuple(spline_knots(values, count).tolist())
        for signed in signs:
            yield Law(signal, other, signed, loaded_only, knots)


def _since_reversal(view: DriveView) -> FloatArray:
    """Time since the piston's speed last changed its sign, s; up to the first time, since the beginning.

    A change counts once the speed is above its noise; it was where the speed last had the sign before.
    """
    forward, sure = view.v > 0, np.flatnonzero(np.abs(view.v) > _SURE * view.noise[view.joint].speed)
    since = np.zeros(len(forward), dtype=int)
    for number in np.flatnonzero(np.diff(forward[sure])).tolist():
        before, after = int(sure[number]), int(sure[number + 1])
        turned = before + 1 + int(np.flatnonzero(forward[before:after] == forward[before])[-1])
        since[turned] = turned
    return np.asarray((np.arange(len(forward)) - np.maximum.accumulate(since)) / view.bank.rate_hz)


def _temperature(view: DriveView) -> FloatArray:
    temperature = view.segment.temperature
    assert temperature is not None
    return temperature
