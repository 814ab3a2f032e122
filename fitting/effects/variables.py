"""Variables of a joint: signals, its own and a neighbour's, that laws are of and residuals are drawn against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView

#: signal name -> (unit, getter)
OWN: dict[str, tuple[str, Callable[[DriveView], FloatArray]]] = {
    "piston_position": ("m", lambda view: view.x),
    "piston_speed": ("m/s", lambda view: view.v),
    "piston_acceleration": ("m/s^2", lambda view: view.a),
    "cylinder_force": ("N", lambda view: view.force),
    "force_rate": ("N/s", lambda view: view.bank.rate(view.force)),
    "head_pressure": ("Pa", lambda view: view.p1),
    "rod_pressure": ("Pa", lambda view: view.p2),
    "time": ("s", lambda view: view.clock),
    "time_since_reversal": ("s", lambda view: (np.arange(len(view.v)) - _last_reversal(view)) / view.bank.rate_hz),
    "distance_since_reversal": ("m", lambda view: np.abs(view.x - view.x[_last_reversal(view)])),
    "oil_temperature": ("K", lambda view: _temperature(view)),
    "link_angle": ("rad", lambda view: _link_angle(view, view.joint)),
    "total_flow": ("m^3/s", lambda view: _total_flow(view)),
}
NEIGHBOUR: dict[str, tuple[str, Callable[[DriveView, int], FloatArray]]] = {
    "joint_position": ("rad", lambda view, other: view.segment.q[:, other]),
    "piston_speed": ("m/s", lambda view, other: view.segment.v[:, other]),
    "piston_acceleration": ("m/s^2", lambda view, other: view.segment.a[:, other]),
    "cylinder_force": ("N", lambda view, other: view.forces[:, other]),
    "head_pressure": ("Pa", lambda view, other: view.head_pressure_of(other)),
    "rod_pressure": ("Pa", lambda view, other: view.rod_pressure_of(other)),
    "link_angle": ("rad", lambda view, other: _link_angle(view, other)),
}
#: Deviations of the speed's noise above which its sign is sure.
_SURE = 3.0


def values_of(view: DriveView, signal: str, other: int | None) -> FloatArray:
    """Return a signal (N,) of the joint, or of a neighbour."""
    return OWN[signal][1](view) if other is None else NEIGHBOUR[signal][1](view, other)


def parallel_joints(machine: Machine, joint: int) -> range:
    """Return the joints up to this one with axes parallel to its own, no turned link between: their angles add up."""
    first = joint
    joints = machine.joints
    while first > 0 and abs(joints[first - 1].dh.alpha) < 1e-9 and joints[first - 1].type == "revolute":
        first -= 1
    return range(first, joint + 1)


def _link_angle(view: DriveView, joint: int) -> FloatArray:
    """Compute a link's angle from the start of its chain of parallel axes, rad (N,)."""
    parallel = parallel_joints(view.machine, joint)
    return np.asarray(view.segment.q[:, parallel.start : parallel.stop].sum(axis=1))


def _total_flow(view: DriveView) -> FloatArray:
    """Compute the flow of all cylinders' head sides together, m^3/s (N,)."""
    areas = [0.0 if joint.cylinder is None else joint.cylinder.head_area for joint in view.machine.joints]
    return np.asarray(np.abs(view.segment.v) @ np.array(areas))


def _last_reversal(view: DriveView) -> npt.NDArray[np.intp]:
    """Return the sample of the piston speed's last change of sign (N,); before any, the beginning.

    A change counts once the speed is above its noise; it was where the speed last had the sign before.
    """
    forward, sure = view.v > 0, np.flatnonzero(np.abs(view.v) > _SURE * view.noise[view.joint].sign)
    since = np.zeros(len(forward), dtype=int)
    for number in np.flatnonzero(np.diff(forward[sure])).tolist():
        before, after = int(sure[number]), int(sure[number + 1])
        turned = before + 1 + int(np.flatnonzero(forward[before:after] == forward[before])[-1])
        since[turned] = turned
    return np.asarray(np.maximum.accumulate(since))


def _temperature(view: DriveView) -> FloatArray:
    temperature = view.segment.temperature
    assert temperature is not None
    return temperature
