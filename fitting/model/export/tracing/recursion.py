"""One moment of an arm, and Newton's and Euler's recursion, in nodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fitting.arm.geometry import Geometry
from fitting.arrays import FloatArray
from fitting.model.export.tracing.graph import Graph, Node, Value

Vector = tuple[Value, Value, Value]


@dataclass(frozen=True)
class State:
    """A moment: position, speed, acceleration of every joint (n nodes or numbers each), time since the beginning."""

    q: Sequence[Value]
    qd: Sequence[Value]
    qdd: Sequence[Value]
    t: Value


def newton_euler(
    graph: Graph, geometry: Geometry, pi: FloatArray, state: State, gravity: FloatArray
) -> tuple[Node, ...]:
    """Compute joint efforts by Newton's and Euler's recursion, in frames of the links.

    Link ``i`` needs the force ``f = m a + w' x h + w x (w x h)`` and, about its frame's origin, the moment
    ``n = h x a + I w' + w x (I w)``, with ``h`` its first moments and ``I`` its inertia about that origin
    (:mod:`fitting.arm.dynamics` has the symbols and the sources).

    Parameters
    ----------
    pi : (n, 10) inertial parameters
    gravity : (3,) m/s^2 in the base frame
    """
    zero = graph.number(0.0)
    w: Vector = (zero, zero, zero)
    wd: Vector = w
    a: Vector = (graph.number(-gravity[0]), graph.number(-gravity[1]), graph.number(-gravity[2]))
    steps: list[tuple[_Row, Vector, Vector]] = []
    for i in range(geometry.joints):
        row = _row(graph, geometry, i, state.q[i])
        qd, qdd = graph.of(state.qd[i]), graph.of(state.qdd[i])
        if geometry.modified:  # link i - 1 reaches to joint i before that moves
            a = _plus(a, _plus(_cross(wd, row.arm), _cross(w, _cross(w, row.arm))))
            w, wd, a = (row.about_x(vector) for vector in (w, wd, a))
        if geometry.revolute[i]:
            wd = (wd[0] + qd * w[1], wd[1] - qd * w[0], wd[2] + qdd)
            w = (w[0], w[1], w[2] + qd)
        else:
            a = (a[0] + 2.0 * qd * w[1], a[1] - 2.0 * qd * w[0], a[2] + qdd)
        w, wd, a = (row.about_z(vector) for vector in (w, wd, a))
        if not geometry.modified:
            w, wd, a = (row.about_x(vector) for vector in (w, wd, a))
            a = _plus(a, _plus(_cross(wd, row.arm), _cross(w, _cross(w, row.arm))))
        m, inertia = float(pi[i, 0]), _matrix(pi[i, 4:])
        h: Vector = (float(pi[i, 1]), float(pi[i, 2]), float(pi[i, 3]))
        f = _plus((m * a[0], m * a[1], m * a[2]), _plus(_cross(wd, h), _cross(w, _cross(w, h))))
        n = _plus(_cross(h, a), _plus(_times(inertia, wd), _cross(w, _times(inertia, w))))
        steps.append((row, f, n))
    return _backward(graph, geometry, steps)


@dataclass(frozen=True)
class _Row:
    """One row of the Denavit-Hartenberg table.

    Attributes
    ----------
    about_x, about_z : turn a vector into the frame that is turned about that axis
    back : a vector of the frame after the row, in the frame before it
    arm : from one frame's origin to the other's; in the frame before of a modified table, after of a distal one
    """

    about_x: Callable[[Vector], Vector]
    about_z: Callable[[Vector], Vector]
    back: Callable[[Vector], Vector]
    arm: Vector


def _row(graph: Graph, geometry: Geometry, i: int, q: Value) -> _Row:
    sa, ca = float(geometry.sin_alpha[i]), float(geometry.cos_alpha[i])
    revolute = bool(geometry.revolute[i])
    angle = graph.of(geometry.theta[i] + q) if revolute else graph.number(geometry.theta[i])
    ct, st = angle.cos(), angle.sin()
    d = graph.number(geometry.d[i]) if revolute else graph.of(geometry.d[i] + q)
    along = graph.number(geometry.a[i])

    def about_x(v: Vector) -> Vector:
        return v[0], ca * v[1] + sa * v[2], ca * v[2] - sa * v[1]

    def about_z(v: Vector) -> Vector:
        return ct * v[0] + st * v[1], ct * v[1] - st * v[0], v[2]

    def back_x(v: Vector) -> Vector:
        return v[0], ca * v[1] - sa * v[2], sa * v[1] + ca * v[2]

    def back_z(v: Vector) -> Vector:
        return ct * v[0] - st * v[1], st * v[0] + ct * v[1], v[2]

    if geometry.modified:
        return _Row(about_x, about_z, lambda v: back_x(back_z(v)), (along, -sa * d, ca * d))
    return _Row(about_x, about_z, lambda v: back_z(back_x(v)), (along, sa * d, ca * d))


def _backward(graph: Graph, geometry: Geometry, steps: Sequence[tuple[_Row, Vector, Vector]]) -> tuple[Node, ...]:
    """Compute joint efforts from links' forces and moments about their own origin, tip to base."""
    n = len(steps)
    tau: list[Node] = [graph.number(0.0)] * n
    zero = graph.number(0.0)
    force: Vector = (zero, zero, zero)
    moment: Vector = force
    for i in reversed(range(n)):
        row, f, own = steps[i]
        force, moment = _plus(force, f), _plus(moment, own)  # of link i and all behind it, about its origin, its frame
        if not geometry.modified:  # joint i is at the frame before: its axis is that one's z
            moment = _plus(moment, _cross(row.arm, force))
            force, moment = row.back(force), row.back(moment)
            tau[i] = graph.of(moment[2] if geometry.revolute[i] else force[2])
        else:  # joint i is at this frame's origin, along its z
            tau[i] = graph.of(moment[2] if geometry.revolute[i] else force[2])
            force, moment = row.back(force), row.back(moment)
            moment = _plus(moment, _cross(row.arm, force))
    return tuple(tau)


def _matrix(inertia: FloatArray) -> tuple[Vector, Vector, Vector]:
    xx, xy, xz, yy, yz, zz = inertia.tolist()
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def _times(matrix: tuple[Vector, Vector, Vector], v: Vector) -> Vector:
    return tuple(row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in matrix)


def _plus(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
