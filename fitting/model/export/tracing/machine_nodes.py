"""The machine itself in nodes: links, drives, linkages and chamber pressures, without effects."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.model.arm_model import ArmModel, Pass
from fitting.model.export.tracing.graph import Graph, Node, spline_curve
from fitting.model.export.tracing.linkage_nodes import linkage_of
from fitting.model.export.tracing.moment import State, Value
from fitting.model.export.tracing.recursion import newton_euler
from fitting.model.export.tracing.traced_arrays import power, sign
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
        if gravity is not None:
            return tau
        noise = np.array([own.speed for own in self.model.noise])
        for place, row in enumerate(self.geometry.coupling):
            f_c, f_v, inertia = standard[10 * n + 3 * place : 10 * n + 3 * place + 3]
            speed = _dot(row, state.qd)
            effort = f_c * sign(self.graph, speed, float(np.linalg.norm(noise * row)))
            effort = effort + f_v * speed + inertia * _dot(row, state.qdd)
            felt = [0.0 if joint in self.geometry.link_side else float(row[joint]) for joint in range(n)]
            tau = tuple(self.graph.of(own + share * effort) for own, share in zip(tau, felt, strict=True))
        return tau

    def drive(self, joint: int, theta: FloatArray, x: Value, v: Value, a: Value) -> Value:
        """Effort of the drive's own mass, stiffness and friction, the known part included."""
        names = self.model.parameters.drive[joint]
        values = theta[self.model.parameters.drive_slice(joint)]
        noise, graph = self.model.noise[joint].speed, self.graph
        makers: dict[str, Callable[[], Value]] = {
            "m": lambda: a,
            "J": lambda: a,
            "K": lambda: x,
            "f_c": lambda: sign(graph, v, noise),
            "f_v": lambda: v,
            "f_s": lambda: power(graph, v, noise, 1 / 3),
            "f_0": lambda: 1.0,
        }
        total: Value = graph.number(0.0)
        for name, value in zip(names, values, strict=True):
            total = total + float(value) * makers[name]()
        cylinder = self._arm.joints[joint].cylinder
        return total if cylinder is None else total + cylinder.damping * v + (cylinder.moving_mass or 0.0) * a

    def piston(self, joint: int, state: State) -> tuple[Value, Value, Value, Value]:
        """Position, speed and acceleration of the driving element, and the lever arm."""
        graph, cylinder = self.graph, self._arm.joints[joint].cylinder
        q, qd, qdd = (graph.of(values[joint]) for values in (state.q, state.qd, state.qdd))
        if cylinder is None:
            return q, qd, qdd, graph.number(1.0)
        x, r, slope = linkage_of(cylinder.linkage, q)
        return x, r * qd, r * qdd + slope * (qd * qd), graph.of(r)

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

    def pressures(
        self, own: Pass, segment: Segment, drives: Sequence[Node]
    ) -> tuple[tuple[Node | None, ...], tuple[Node | None, ...]]:
        head: list[Node | None] = []
        rod: list[Node | None] = []
        for joint, (law, described) in enumerate(zip(own.rods, self._arm.joints, strict=True)):
            if law is None or described.cylinder is None:
                head.append(None)
                rod.append(None)
                continue
            second = self.rod(law, segment, joint, drives[joint])
            head.append((drives[joint] + second * described.cylinder.rod_area) / described.cylinder.head_area)
            rod.append(second)
        return tuple(head), tuple(rod)


def _dot(row: FloatArray, values: Sequence[Value]) -> Value:
    total: Value = 0.0
    for share, value in zip(row.tolist(), values, strict=True):
        total = total + share * value
    return total
