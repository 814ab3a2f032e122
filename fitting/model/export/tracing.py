"""A model as expressions of one moment: position, speed and acceleration of every joint, and the time.

The rigid body is Newton's and Euler's recursion with the base parameters on their own columns (the other standard
parameters are zero). Drives and linkages are written out. Effects and laws are *traced*: their own code runs on arrays
of nodes instead of numbers, so no formula exists twice. A term that cannot be traced (a history, a derivative, a
formula that asks for numbers) is named and left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PPoly

from daq.errors import InputError
from daq.linkages import Direct, FourBar, Linkage, Polynomial, Rack, ThreePin, reduced
from fitting.arm.geometry import Geometry, geometry_of
from fitting.effects.base import DriveView, Effect
from fitting.effects.base_tilt import across
from fitting.model.arm_model import FOREIGN, ArmModel, Pass, over_time, phase_unknown
from fitting.model.evaluation import without
from fitting.model.export.graph import Curve, Graph, Node
from fitting.residual.laws import Law
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.residual.views import RodLaw
from fitting.signals.preparation import Segment

FloatArray = npt.NDArray[np.float64]
#: A number or a node.
Value = Any
Vector = tuple[Value, Value, Value]

_COMPARED: dict[Any, Callable[[Value, Value], Value]] = {
    np.greater: lambda a, b: a > b,
    np.greater_equal: lambda a, b: a >= b,
    np.less: lambda a, b: b > a,
    np.less_equal: lambda a, b: b >= a,
}


class Traced(np.ndarray[Any, np.dtype[np.object_]]):
    """An array of nodes; functions that would ask for a truth become nodes as well."""

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> Any:
        """Apply a numpy function element by element."""
        plain = [np.asarray(value, dtype=object) for value in inputs]
        graph = next((v.graph for array in plain for v in array.ravel() if isinstance(v, Node)), None)
        if graph is None:
            raise TypeError(f"{ufunc.__name__} of nothing that is known only at run time")
        if ufunc in _COMPARED:
            result = np.frompyfunc(_COMPARED[ufunc], 2, 1)(*plain)
        elif ufunc in (np.maximum, np.minimum):
            name = "max" if ufunc is np.maximum else "min"
            result = np.frompyfunc(lambda a, b: graph.binary(name, a, b), 2, 1)(*plain)
        elif ufunc is np.sign:
            result = np.frompyfunc(lambda a: graph.unary("sign", a), 1, 1)(*plain)
        elif ufunc.__name__ == "clip":
            result = np.frompyfunc(lambda a, b, c: graph.binary("min", graph.binary("max", a, b), c), 3, 1)(*plain)
        elif method != "__call__" or kwargs:
            raise TypeError(f"{ufunc.__name__} cannot be traced")
        else:
            objects = [np.frompyfunc(graph.of, 1, 1)(array) for array in plain]
            result = ufunc(*objects)
        return traced(result)

    def astype(self, *args: Any, **kwargs: Any) -> Any:
        """The same: nodes are numbers of every kind."""
        return self


def traced(values: Any) -> Traced:
    """Nodes as an array that effects can calculate with."""
    return np.asarray(values, dtype=object).view(Traced)


class _View(DriveView):
    """What an effect looks at, in nodes."""

    @property
    def _graph(self) -> Graph:
        first: Any = self.segment.v[0, 0]
        graph: Graph = first.graph
        return graph

    @cached_property
    def s(self) -> Any:
        """Expected sign of the speed."""
        return traced([sign(self._graph, self.v[0], self.noise[self.joint].speed)])

    def power(self, exponent: float) -> Any:
        """Expected signed power of the speed."""
        return traced([power(self._graph, self.v[0], self.noise[self.joint].speed, exponent)])


def sign(graph: Graph, speed: Value, noise: float) -> Node:
    """Expected sign of a speed: see :func:`fitting.arm.expected.expected_sign`."""
    speed = graph.of(speed)
    if noise <= 0:
        return graph.unary("sign", speed)
    return graph.unary("erf", speed / (np.sqrt(2.0) * noise))


def power(graph: Graph, speed: Value, noise: float, exponent: float) -> Node:
    """Expected signed power of a speed."""
    speed = graph.of(speed)
    if speed.is_number(0.0):
        return graph.number(0.0)
    return graph.signed_power(speed, max(noise, 0.0), exponent)


@dataclass(frozen=True)
class State:
    """A moment: position, speed, acceleration of every joint (n nodes or numbers each), time since the beginning."""

    q: Sequence[Value]
    qd: Sequence[Value]
    qdd: Sequence[Value]
    t: Value


@dataclass(frozen=True)
class Efforts:
    """What a model says of a moment, per joint.

    Attributes
    ----------
    joint, drive : effort of the joint (N m, N) and of its drive (N at a piston)
    head, rod : chamber pressures, Pa; None where there is no cylinder or no pressure was measured
    """

    joint: tuple[Node, ...]
    drive: tuple[Node, ...]
    head: tuple[Node | None, ...]
    rod: tuple[Node | None, ...]


class Tracer:
    """Expressions of a model.

    Attributes
    ----------
    graph : of all of them
    left_out : a line for each term that is not in them
    """

    def __init__(self, model: ArmModel) -> None:
        self.model, self.graph = model, Graph()
        self.left_out: list[str] = []
        self._geometry, self._arm = geometry_of(model.arm), model.arm
        for joint in self._arm.joints:
            if joint.cylinder is not None and isinstance(reduced(joint.cylinder.linkage), FourBar):
                raise InputError(
                    f"export: {joint.name} has a four-bar linkage, which no format has; calculate with hilfit itself"
                )
        self._terms = self._traceable()

    @property
    def carried(self) -> ArmModel:
        """The part of the model that is in the expressions."""
        return without(self.model, set(range(len(self.model.terms))) - set(self._terms))

    def variables(self) -> State:
        """A moment that is known at run time: variables ``q0 ...``, ``v0 ...``, ``a0 ...`` and ``t``."""
        n = range(len(self.model.joints))
        q, qd, qdd = ([self.graph.variable(f"{letter}{joint}") for joint in n] for letter in "qva")
        return State(q, qd, qdd, self.graph.variable("t"))

    def _traceable(self) -> list[int]:
        """Numbers of the terms that can be traced; the others are noted."""
        model, kept = self.model, list[int]()
        variables = self.variables()
        for number, term in enumerate(model.terms):
            place = "the machine" if term.joint is None else model.joints[term.joint]
            name = "a law" if isinstance(term.content, Law) else term.content.title
            if term.id == "sensor_latency":
                why = "it belongs to the sensors"
            elif phase_unknown(term, FOREIGN):
                why = "its phase belongs to single recordings"
            elif over_time(term):
                why = "it needs the motion before"
            elif isinstance(term.content, Law) and any(s == "oil_temperature" for s, _ in term.content.signals):
                why = "it needs the oil's temperature"
            else:
                try:
                    self._efforts(variables, [*kept, number])
                    kept.append(number)
                    continue
                except (TypeError, ValueError, AttributeError, NotImplementedError):
                    why = "its formula cannot be written for one moment"
            self.left_out.append(f"{name} at {place}: {why}")
        return kept

    def efforts(self, state: State) -> Efforts:
        """Efforts and pressures of a moment."""
        return self._efforts(state, self._terms)

    def gravity(self, q: Sequence[Value]) -> tuple[Node, ...]:
        """Joint efforts that hold the links still."""
        still = [0.0] * len(q)
        return self._links(State(q, still, still, 0.0), self.model.theta[self.model.parameters.base_slice])

    def friction(self, state: State) -> tuple[Node, ...]:
        """Joint efforts that change their sign with the speed's: see :func:`fitting.model.motion.friction`."""
        still = [0.0] * len(state.q)
        forward = self.efforts(State(state.q, state.qd, still, state.t)).joint
        back = self.efforts(State(state.q, [-v for v in state.qd], still, state.t)).joint
        return tuple(0.5 * (a - b) for a, b in zip(forward, back, strict=True))

    def _efforts(self, state: State, terms: Sequence[int]) -> Efforts:
        graph, model, n = self.graph, self.model, len(self.model.joints)
        x, v, a, r = zip(*(self._piston(joint, state) for joint in range(n)), strict=True)
        segment = self._segment(state, x, v, a, r)
        columns: dict[int, Any] = {}
        drives: list[Node] = []
        for number, own in enumerate(model.passes):
            base = own.theta[model.parameters.base_slice]
            links = self._links(state, base)
            loads = [tau / lever for tau, lever in zip(links, r, strict=True)]
            drives = [self._drive(joint, own.theta, x[joint], v[joint], a[joint]) + loads[joint] for joint in range(n)]
            for term in terms if columns else ():
                self._add(drives, term, own, columns[term])
            if number < len(model.passes) - 1 or number == 0:
                views = self._views(own, segment, drives, loads)
                columns = {term: self._columns(term, own, state, views, r) for term in terms}
                if len(model.passes) == 1:
                    for term in terms:
                        self._add(drives, term, own, columns[term])
        head, rod = self._pressures(model.passes[-1], segment, drives)
        joint_efforts = tuple(graph.of(lever * force) for lever, force in zip(r, drives, strict=True))
        return Efforts(joint_efforts, tuple(graph.of(d) for d in drives), head, rod)

    def _add(self, drives: list[Node], number: int, own: Pass, columns: Any) -> None:
        """Add a term's part to the drives' efforts; a pass that had no terms yet has no parameters for it."""
        term, place = self.model.terms[number], len(self.model.parameters)
        place += sum(len(t.names(self.model.joints)) for t in self.model.terms[:number])
        values = own.theta[place : place + len(term.names(self.model.joints))]
        for joint, own_columns in columns.items():
            if callable(own_columns):
                drives[joint] = drives[joint] + own_columns(values)
            elif len(values):
                for column, value in zip(own_columns, values, strict=True):
                    drives[joint] = drives[joint] + float(value) * column

    def _columns(
        self, number: int, own: Pass, state: State, views: Sequence[_View], r: Sequence[Value]
    ) -> dict[int, Any]:
        """Columns of a term in one moment by joint, or what makes its part of them from its values."""
        term = self.model.terms[number]
        content = term.content
        if isinstance(content, Law) and not isinstance(content, Surface):
            return {term.joint or 0: self._law(term, content, views[term.joint or 0])}
        if term.id == "base_tilt":
            return self._tilt(own, state, r)
        if term.id == "payload":
            return self._payload(term, state, r)
        if isinstance(content, Effect) and term.everywhere:
            raise TypeError(f"{term.id} acts on all joints by numbers")
        found = np.asarray(term.columns(views), dtype=object)
        return {term.joint or 0: list(found[0])}

    def _law(self, term: Term, law: Law, view: _View) -> Callable[[FloatArray], Value]:
        signal = np.asarray(law.values(view), dtype=object).ravel()[0]
        factor = view.s[0] if law.signed else 1.0

        def part(values: FloatArray) -> Value:
            if not len(values):
                return 0.0
            return self.graph.curve(signal, spline_curve(np.asarray(law.knots), values)) * factor

        return part

    def _tilt(self, own: Pass, state: State, r: Sequence[Value]) -> dict[int, Any]:
        base = own.theta[self.model.parameters.base_slice]
        down = np.asarray(self._arm.gravity, dtype=float)
        still = [0.0] * len(r)
        sides = [
            self._links(State(state.q, still, still, 0.0), base, axis * np.linalg.norm(down)) for axis in across(down)
        ]
        return {joint: [side[joint] / r[joint] for side in sides] for joint in range(len(r))}

    def _payload(self, term: Term, state: State, r: Sequence[Value]) -> dict[int, Any]:
        if int(term.shape["recording"]) != -1:
            return {}
        pi = np.zeros((len(r), 10))
        pi[-1, 0] = 1.0
        there = self.graph.binary("at_least", state.t, term.shape["t_0"])
        tau = newton_euler(self.graph, self._geometry, pi, state, self._geometry.gravity)
        return {joint: [tau[joint] / r[joint] * there] for joint in range(len(r))}

    def _links(self, state: State, base: FloatArray, gravity: FloatArray | None = None) -> tuple[Node, ...]:
        """Joint efforts of links and coupled motors; with ``gravity`` that of the links alone."""
        n = len(state.q)
        standard = self.model.base.standard_example(base)
        g = self._geometry.gravity if gravity is None else gravity
        tau = newton_euler(self.graph, self._geometry, standard[: 10 * n].reshape(n, 10), state, g)
        if gravity is not None:
            return tau
        noise = np.array([own.speed for own in self.model.noise])
        for place, row in enumerate(self._geometry.coupling):
            f_c, f_v, inertia = standard[10 * n + 3 * place : 10 * n + 3 * place + 3]
            speed = _dot(row, state.qd)
            effort = f_c * sign(self.graph, speed, float(np.linalg.norm(noise * row)))
            effort = effort + f_v * speed + inertia * _dot(row, state.qdd)
            felt = [0.0 if joint in self._geometry.link_side else float(row[joint]) for joint in range(n)]
            tau = tuple(self.graph.of(own + share * effort) for own, share in zip(tau, felt, strict=True))
        return tau

    def _drive(self, joint: int, theta: FloatArray, x: Value, v: Value, a: Value) -> Value:
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

    def _piston(self, joint: int, state: State) -> tuple[Value, Value, Value, Value]:
        """Position, speed and acceleration of the driving element, and the lever arm."""
        graph, cylinder = self.graph, self._arm.joints[joint].cylinder
        q, qd, qdd = (graph.of(values[joint]) for values in (state.q, state.qd, state.qdd))
        if cylinder is None:
            return q, qd, qdd, graph.number(1.0)
        x, r, slope = linkage_of(cylinder.linkage, q)
        return x, r * qd, r * qdd + slope * (qd * qd), graph.of(r)

    def _segment(
        self, state: State, x: Sequence[Value], v: Sequence[Value], a: Sequence[Value], r: Sequence[Value]
    ) -> Segment:
        def row(values: Sequence[Value]) -> Any:
            return traced([[self.graph.of(value) for value in values]])

        time: Any = traced([self.graph.of(state.t)])
        unknown = np.full((1, len(x)), np.nan)
        return Segment(
            recording=FOREIGN,
            role="operation",
            start=0,
            t=time,
            q=row(state.q),
            qd=row(state.qd),
            qdd=row(state.qdd),
            x=row(x),
            v=row(v),
            a=row(a),
            r=row(r),
            effort=unknown,
            p1=unknown,
            p2=unknown,
            rest=np.zeros((1, len(x)), dtype=bool),
            loaded=True,
            temperature=None,
            gap=unknown,
        )

    def _views(self, own: Pass, segment: Segment, drives: Sequence[Value], loads: Sequence[Value]) -> tuple[_View, ...]:
        def row(values: Sequence[Value]) -> Any:
            return traced([[self.graph.of(value) for value in values]])

        return tuple(
            _View(
                machine=self._arm,
                joint=joint,
                segment=segment,
                bank=self.model.bank,
                noise=self.model.noise,
                forces=row(drives),
                loads=row(loads),
                rod_pressures=lambda: row(
                    [
                        float("nan") if law is None else self._rod(law, segment, j, drives[j])
                        for j, law in enumerate(own.rods)
                    ]
                ),
                ranges=own.ranges,
                clock=segment.t,
                base=self.model.base,
                base_values=own.theta[self.model.parameters.base_slice],
                loaded_recordings=(),
            )
            for joint in range(len(drives))
        )

    def _rod(self, law: RodLaw, segment: Segment, joint: int, force: Value) -> Node:
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

    def _pressures(
        self, own: Pass, segment: Segment, drives: Sequence[Node]
    ) -> tuple[tuple[Node | None, ...], tuple[Node | None, ...]]:
        head: list[Node | None] = []
        rod: list[Node | None] = []
        for joint, (law, described) in enumerate(zip(own.rods, self._arm.joints, strict=True)):
            if law is None or described.cylinder is None:
                head.append(None)
                rod.append(None)
                continue
            second = self._rod(law, segment, joint, drives[joint])
            head.append((drives[joint] + second * described.cylinder.rod_area) / described.cylinder.head_area)
            rod.append(second)
        return tuple(head), tuple(rod)


def linkage_of(linkage: Linkage, q: Value) -> tuple[Value, Value, Value]:
    """Piston position, lever arm and its slope at a joint position: see :mod:`fitting.arm.linkage`."""
    linkage = reduced(linkage)
    if isinstance(linkage, ThreePin):
        a, b, angle = linkage.a, linkage.b, q + linkage.offset
        product = a * b
        cosine, sine = angle.cos(), angle.sin()
        length = ((a * a + b * b) - 2.0 * product * cosine).sqrt()
        r = product * sine / length
        return length - linkage.retracted, r, (product * cosine - r * r) / length
    if isinstance(linkage, Rack):
        return linkage.radius * (q - linkage.zero), linkage.radius, 0.0
    if isinstance(linkage, Polynomial):
        coefficients = np.asarray(linkage.coefficients)
        of = np.polynomial.polynomial
        return tuple(_horner(of.polyder(coefficients, order), q) for order in range(3))
    assert isinstance(linkage, Direct)
    return q, 1.0, 0.0


def _horner(coefficients: FloatArray, q: Value) -> Value:
    total: Value = 0.0
    for value in coefficients[::-1].tolist():
        total = total * q + value
    return total


def spline_curve(knots: FloatArray, values: FloatArray) -> Curve:
    """A cubic spline as pieces."""
    pieces = PPoly.from_spline((knots, values, 3))
    inside = np.diff(pieces.x) > 0
    return Curve(np.append(pieces.x[:-1][inside], pieces.x[-1]), pieces.c[:, inside].T)


def _dot(row: FloatArray, values: Sequence[Value]) -> Value:
    total: Value = 0.0
    for share, value in zip(row.tolist(), values, strict=True):
        total = total + share * value
    return total


def newton_euler(
    graph: Graph, geometry: Geometry, pi: FloatArray, state: State, gravity: FloatArray
) -> tuple[Node, ...]:
    """Joint efforts by Newton's and Euler's recursion, in frames of the links.

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
    """Joint efforts from every link's force and moment about its own origin, tip to base."""
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
