"""Moments of an arm in nodes: one of them, by Newton's and Euler's recursion, and what is kept from one to the next.

An effect with a history is traced at a few moments at once, by its own code. What the expression of one moment takes
from before it, and that of the next moment takes from the same place, is one number of a memory; the expression of
that number is how it goes on. So a recurrence is read off the formula, and no formula exists twice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fitting.arm.geometry import Geometry
from fitting.arrays import FloatArray
from fitting.model.export.tracing.graph import BINARY, UNARY, Graph, Node, Value

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


#: Moments that are traced: a chain of numbers, each of which begins with the one before, may be this long less three.
MOMENTS = 6


@dataclass(frozen=True)
class Memory:
    """A number that is kept from moment to moment.

    Attributes
    ----------
    name : of its variable
    start : at the first moment
    after : at every later one, of its variable and of that moment
    """

    name: str
    start: Node
    after: Node


@dataclass(frozen=True)
class Remembered:
    """Columns of a term with a history: at the first moment, and at every later one; and what they remember."""

    first: tuple[Node, ...]
    later: tuple[Node, ...]
    memory: tuple[Memory, ...]


def remembered(
    graph: Graph, columns: Sequence[Sequence[Node]], moments: Sequence[Mapping[str, Node]], taken: int
) -> Remembered:
    """Find the recurrence in a term's columns.

    Parameters
    ----------
    columns : nodes of each of :data:`MOMENTS` moments
    moments : variables of each by the name of the one that they become
    taken : how many numbers other terms remember

    Raises
    ------
    TypeError
        If the moments are not made alike, or take more and more from before.
    """
    chains = _chains(graph, [list(own) for own in zip(*columns, strict=True)], moments)
    names = {chain[0].number: graph.variable(f"m{taken + k}") for k, chain in enumerate(chains)}

    def now(node: Node, moment: int) -> Node:
        known = {variable.number: graph.variable(name) for name, variable in moments[moment].items()}
        return _rewritten(graph, node, known if moment == 0 else known | names)

    return Remembered(
        tuple(now(node, 0) for node in columns[0]),
        tuple(now(node, 1) for node in columns[1]),
        tuple(Memory(f"m{taken + k}", now(chain[0], 0), now(chain[1], 1)) for k, chain in enumerate(chains)),
    )


def _chains(graph: Graph, columns: list[list[Node]], moments: Sequence[Mapping[str, Node]]) -> list[list[Node]]:
    """List the nodes of each remembered number, moment by moment."""
    place = {own.number: (name, k) for k, variables in enumerate(moments) for name, own in variables.items()}
    latest: dict[int, int] = {}
    for node in graph.nodes:
        own = place[node.number][1] if node.number in place else -1
        latest[node.number] = max([own, *(latest[argument.number] for argument in node.arguments)])

    def cut(a: Node, b: Node, moment: int, found: list[tuple[Node, Node]]) -> bool:
        """Return whether ``b`` is the next moment's ``a``; what both take from before is noted."""
        if latest[a.number] < 0:
            return a is b
        if latest[a.number] < moment:
            found += [] if (a, b) in found else [(a, b)]
            return latest[b.number] <= moment
        if (a.operation, len(a.arguments)) != (b.operation, len(b.arguments)):
            return False
        if a.operation == "variable":
            return place[b.number] == (place[a.number][0], moment + 1)
        if a.value != b.value:
            return False
        orders = [b.arguments, b.arguments[::-1]] if a.operation in ("add", "mul") else [b.arguments]
        for order in orders:  # which of two is first is chance
            trial = list(found)
            if all(cut(x, y, moment, trial) for x, y in zip(a.arguments, order, strict=True)):
                found[:] = trial
                return True
        return False

    known: dict[int, list[Node]] = {}
    todo = [*columns]
    while todo:
        chain = todo.pop(0)
        before: list[list[tuple[Node, Node]]] = []
        for moment in range(1, len(chain) - 1):
            before.append([])
            if not cut(chain[moment], chain[moment + 1], moment, before[-1]):
                raise TypeError("moments that follow each other are not made alike")
        if not before or len({len(own) for own in before}) > 1:
            raise TypeError("every moment takes more from before")
        for links in zip(*before, strict=True):
            found = [links[0][0], *(after for _, after in links)]
            if known.setdefault(found[0].number, found) is found:
                todo.append(found)
    return list(known.values())


def _rewritten(graph: Graph, node: Node, known: Mapping[int, Node]) -> Node:
    """Replace some of the nodes that a node is made of."""
    made = dict(known)
    todo = [node]
    while todo:
        own = todo[-1]
        missing = [argument for argument in own.arguments if argument.number not in made]
        if own.number in made or not missing:
            todo.pop()
            if own.number not in made:
                arguments = [made[argument.number] for argument in own.arguments]
                if own.operation in BINARY:
                    made[own.number] = graph.binary(own.operation, *arguments)
                elif own.operation in UNARY:
                    made[own.number] = graph.unary(own.operation, *arguments)
                else:
                    made[own.number] = graph.node(own.operation, tuple(arguments), own.value)
        todo += missing if own.number not in made else []
    return made[node.number]
