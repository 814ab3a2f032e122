"""The machine itself in nodes: links, drives, linkages and chamber pressures, without effects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arm.dynamics import coupled_regressor
from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.model.arm_model import ArmModel, Pass
from fitting.model.export.tracing.graph import Graph, Node, spline_curve
from fitting.model.export.tracing.moment import State, Value
from fitting.model.export.tracing.recursion import newton_euler
from fitting.model.export.tracing.traced_arrays import sign, traced
from fitting.regression.drive import drive_columns, known_effort
from fitting.residual.views import RodLaw
from fitting.signals.preparation import Segment


class MachineNodes:
    """Expressions of a machine's parts.

    Attributes
    ----------
    geometry : of the links
    """

    def __init__(self, model: ArmModel, graph: Graph) -> None:
        self.model, self.graph = model, graph
        self.geometry, self._arm = geometry_of(model.arm), model.arm

    def links(self, state: State, base: FloatArray, gravity: FloatArray | None = None) -> tuple[Node, ...]:
        """Joint efforts of links and coupled motors; with ``gravity`` that of the links alone."""
        n = len(state.q)
        standard = self.model.base.standard_example(base)
        g = self.geometry.gravity if gravity is None else gravity
        tau = newton_euler(self.graph, self.geometry, standard[: 10 * n].reshape(n, 10), state, g)
        if gravity is not None or not self.geometry.coupled:
            return tau
        noise = np.array([own.speed for own in self.model.noise])
        qd, qdd = (traced([[self.graph.of(value) for value in own]]) for own in (state.qd, state.qdd))
        motors = coupled_regressor(self.geometry, qd, qdd, speed_noise=noise)[0] @ standard[10 * n :]
        return tuple(self.graph.of(own + more) for own, more in zip(tau, motors, strict=True))

    def drive(self, joint: int, theta: FloatArray, segment: Segment) -> Value:
        """Effort of the drive's own mass, stiffness and friction, the known part included."""
        own, x, v, a = self.model.parameters, *(rows[:, joint] for rows in (segment.x, segment.v, segment.a))
        columns = drive_columns(own.drive[joint], x, v, a, self.model.noise[joint].speed)
        return (columns @ theta[own.drive_slice(joint)] + known_effort(self._arm.joints[joint], v, a))[0]

    def rod(self, law: RodLaw, segment: Segment, joint: int, force: Value) -> Node:
        """Expected rod pressure."""
        v = segment.v[0, joint]
        signals = (v, force, segment.x[0, joint], segment.a[0, joint], segment.t[0])
        total, place = self.graph.number(0.0), 0
        for signal, knots in zip(signals, law.knots, strict=True):
            count = len(knots) - 4
            total = total + self.graph.curve(signal, spline_curve(knots, law.coefficients[place : place + count]))
            place += count
        way = sign(self.graph, v, law.speed_noise)
        of_sign, of_both = law.coefficients[place : place + 2].tolist()
        return self.graph.of(total + of_sign * way + of_both * (way * force))

    def pressures(self, own: Pass, segment: Segment, drives: Sequence[Node]) -> dict[str, tuple[Node, ...]]:
        """Pressures ``head`` and ``rod`` of all joints, Pa; none where one has no cylinder, or none was measured."""
        rod, head = list[Node](), list[Node]()
        for joint, (law, described) in enumerate(zip(own.rods, self._arm.joints, strict=True)):
            if law is None or described.cylinder is None:
                return {}
            rod.append(self.rod(law, segment, joint, drives[joint]))
            head.append((drives[joint] + rod[-1] * described.cylinder.rod_area) / described.cylinder.head_area)
        return {"head": tuple(head), "rod": tuple(rod)}
