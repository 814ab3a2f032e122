"""By how much a joint's efforts are later than its positions, from what the machine file says of its buses."""

from __future__ import annotations

import numpy as np

from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray

POSITIONS = ("joint_position", "piston_position", "motor_position")
#: s, standard deviation of what a transmitter's own filter adds, of which buses know nothing: response times of
#: hydraulic pressure transmitters are 1 to 30 ms.
OWN_FILTER_S = 0.01
EFFORTS = ("head_pressure", "rod_pressure", "cylinder_force", "joint_effort", "motor_effort")


def expected_delays(machine: Machine) -> tuple[FloatArray, FloatArray] | None:
    """Return seconds (n,) by which efforts lag each joint's positions, and standard deviations (n,).

    NaN where the machine file lacks the two buses, where efforts or positions come over several buses, and
    where efforts would be earlier: then positions are late, which no effect of a joint is. None: of no joint.

    Delays are those between buses; deviations hold :data:`OWN_FILTER_S` as well.
    """
    if not machine.delays:
        return None
    delay, std = np.full(len(machine.joints), np.nan), np.full(len(machine.joints), np.nan)
    for number, joint in enumerate(machine.joints):
        positions, efforts = _buses(machine, joint.name, POSITIONS), _buses(machine, joint.name, EFFORTS)
        if len(positions) == len(efforts) == 1:
            behind = _behind(machine, efforts.pop(), positions.pop())
            if behind is not None and behind[0] > -2.0 * behind[1]:
                delay[number], std[number] = behind[0], float(np.hypot(behind[1], OWN_FILTER_S))
    return None if np.isnan(delay).all() else (delay, std)


def _buses(machine: Machine, joint: str, quantities: tuple[str, ...]) -> set[str]:
    own = [c for c in machine.channels if c.joint == joint and c.quantity in quantities]
    return {"" if c.source is None else c.source.bus for c in own}


def _behind(machine: Machine, bus: str, base: str) -> tuple[float, float] | None:
    """Compute the lag of ``bus`` behind ``base``, s, and standard deviation, along the fewest known delays."""
    reached: dict[str, tuple[float, float]] = {base: (0.0, 0.0)}
    edge = [base]
    while edge and bus not in reached:
        here = edge.pop(0)
        for delay in machine.delays:
            for other, near, sign in ((delay.bus, delay.behind, 1.0), (delay.behind, delay.bus, -1.0)):
                if near == here and other not in reached:
                    seconds, variance = reached[here]
                    reached[other] = (seconds + sign * delay.seconds, variance + delay.std**2)
                    edge.append(other)
    if bus == base or bus not in reached:
        return None
    seconds, variance = reached[bus]
    return seconds, float(np.sqrt(variance))
