"""A model as expressions of one moment: position, speed and acceleration of every joint, and the time.

The rigid body is Newton's and Euler's recursion (:mod:`~fitting.model.export.tracing.moments`) with the base
parameters on their own columns (the other standard parameters are zero). Drives and linkages are written out. Effects
and laws are *traced*: their own code runs on arrays of
nodes instead of numbers (:mod:`~fitting.model.export.tracing.graph`), so no formula exists twice. One that
has a history is traced at some moments at once and becomes a recurrence
(:mod:`~fitting.model.export.tracing.moments`). A term that cannot be traced (a derivative, a formula that asks for
numbers) is named and left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from daq.errors import InputError
from daq.machine.linkages import FourBar, reduced
from fitting.arm.dynamics import coupled_regressor
from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.effects.base import BodyColumn, DriveView, Effect
from fitting.model.arm_model import FOREIGN, ArmModel, Pass, of_sensors, over_time, phase_unknown
from fitting.model.evaluation import beyond, segment_of, without
from fitting.model.export.tracing.graph import Graph, Node, Value, sign, spline_curve, traced
from fitting.model.export.tracing.moments import MOMENTS, Memory, Remembered, State, newton_euler, remembered
from fitting.model.export.words import refitted
from fitting.model.motion import heated
from fitting.regression.design import Design
from fitting.regression.drive import drive_columns, known_effort
from fitting.residual.laws import Law
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.residual.views import RodLaw, views_of_segment
from fitting.signals.preparation import Segment

#: What terms with a history state: nothing (settled), what they state at a motion's first moment, or at a later one.
Past = Literal["settled", "first", "later"]


class _MachineNodes:
    """Expressions of the machine itself, without effects: links, drives, linkages, chamber pressures."""

    def __init__(self, model: ArmModel, graph: Graph) -> None:
        self.model, self.graph = model, graph
        self.geometry, self._arm = geometry_of(model.arm), model.arm

    def links(self, state: State, base: FloatArray, gravity: FloatArray | None = None) -> tuple[Node, ...]:
        """Compute links' and coupled motors' joint efforts; with ``gravity`` the links' alone."""
        n = len(state.q)
        standard = self.model.base.standard_example(base)
        g = self.geometry.gravity if gravity is None else gravity
        tau = newton_euler(self.graph, self.geometry, standard[: 10 * n].reshape(n, 10), state, g)
        if gravity is not None or not self.geometry.coupled:
            return tau
        noise = np.array([own.sign for own in self.model.noise])
        qd, qdd = (traced([[self.graph.of(value) for value in own]]) for own in (state.qd, state.qdd))
        motors = coupled_regressor(self.geometry, qd, qdd, speed_noise=noise)[0] @ standard[10 * n :]
        return tuple(self.graph.of(own + more) for own, more in zip(tau, motors, strict=True))

    def drive(self, joint: int, theta: FloatArray, segment: Segment) -> Value:
        """Compute the effort of the drive's own mass, stiffness and friction, and known part."""
        own, x, v, a = self.model.parameters, *(rows[:, joint] for rows in (segment.x, segment.v, segment.a))
        columns = drive_columns(own.drive[joint], x, v, a, self.model.noise[joint].sign)
        return (columns @ theta[own.drive_slice(joint)] + known_effort(self._arm.joints[joint], v, a))[0]

    def rod(self, law: RodLaw, segment: Segment, joint: int, force: Value) -> Node:
        """Compute the expected rod pressure."""
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
        """Compute ``head`` and ``rod`` pressures of all joints, Pa; none where one has no cylinder, or no sensor."""
        rod, head = list[Node](), list[Node]()
        for joint, (law, described) in enumerate(zip(own.rods, self._arm.joints, strict=True)):
            if law is None or described.cylinder is None:
                return {}
            rod.append(self.rod(law, segment, joint, drives[joint]))
            head.append((drives[joint] + rod[-1] * described.cylinder.rod_area) / described.cylinder.head_area)
        return {"head": tuple(head), "rod": tuple(rod)}


class Tracer:
    """Expressions of a model.

    Attributes
    ----------
    graph : of all of them; ``dt`` is the time since the moment before
    left_out : a line for each term that is not in them
    lost : numbers of the machine's terms that are not in them
    memory : what has to be kept from moment to moment
    """

    def __init__(self, model: ArmModel) -> None:
        self.model, self.graph = model, Graph()
        self.left_out: list[str] = []
        self.lost = set[int]()
        self._machine, self._arm = _MachineNodes(model, self.graph), model.arm
        self._remembered: dict[int, Remembered] = {}
        for joint in self._arm.joints:
            if joint.cylinder is not None and isinstance(reduced(joint.cylinder.linkage), FourBar):
                raise InputError("fitting.export_four_bar", joint=joint.name)
        self._terms = self._traceable()

    @property
    def carried(self) -> ArmModel:
        """The part of the model that is in the expressions."""
        return without(self.model, set(range(len(self.model.terms))) - set(self._terms))

    @property
    def oil(self) -> tuple[str, ...]:
        """The argument that is the oil's temperature, where the expressions have a law of it."""
        return ("temperature",) if heated(self.carried) else ()

    @property
    def memory(self) -> tuple[Memory, ...]:
        """Values to keep from moment to moment."""
        return tuple(own for number in self._terms for own in self._past(number).memory)

    def variables(self, mark: str = "") -> State:
        """Make a moment known at run time: variables ``q0 ...``, ``v0 ...``, ``a0 ...`` and ``t``."""
        n = range(len(self.model.joints))
        q, qd, qdd = ([self.graph.variable(f"{letter}{joint}{mark}") for joint in n] for letter in "qva")
        return State(q, qd, qdd, self.graph.variable(f"t{mark}"))

    def _traceable(self) -> list[int]:
        """Return numbers of terms that can be traced; note the others."""
        model, kept = self.model, list[int]()
        variables = self.variables()
        for number, term in enumerate(model.terms):
            name = "a law" if isinstance(term.content, Law) else term.content.title
            if of_sensors(term):
                why = "it belongs to the sensors"
            elif phase_unknown(term, FOREIGN):
                why = "its phase belongs to single recordings"
            else:
                try:
                    self._efforts(variables, [*kept, number], "later")
                    kept.append(number)
                    continue
                except (TypeError, ValueError, AttributeError, NotImplementedError, IndexError):
                    why = "its formula cannot be written for one moment and what it remembers"
            self.left_out.append(f"{name} at {model.place(term)}: {why}")
            self.lost |= set() if of_sensors(term) else {number}
        return kept

    def efforts(self, state: State, past: Past = "settled") -> dict[str, tuple[Node, ...]]:
        """Compute joint efforts ``tau`` (N m, N) and drives' ``force`` (N at a piston), pressures where all are known.

        Of a moment; with a past only of that of :meth:`variables`.
        """
        return self._efforts(state, self._terms, past)

    def gravity(self, q: Sequence[Value]) -> tuple[Node, ...]:
        """Compute efforts that hold the arm still: see :func:`fitting.model.motion.gravity`."""
        still = [0.0] * len(q)
        return self.efforts(State(q, still, still, 0.0))["tau"]

    def beyond(self, state: State) -> tuple[Node, ...]:
        """Return 1 of each joint beyond what was recorded: see :func:`fitting.model.evaluation.beyond`."""
        return tuple(beyond(self.model, self._segment([state]))[0])

    def pressed(self, state: State, head: Sequence[Value], rod: Sequence[Value]) -> tuple[Node, ...]:
        """Compute joint efforts of chamber pressures, 0 without a cylinder."""
        cylinders, levers = [joint.cylinder for joint in self._arm.joints], self._segment([state]).r[0]
        return tuple(
            self.graph.of(0.0 if own is None else lever * (own.head_area * p1 - own.rod_area * p2))
            for own, lever, p1, p2 in zip(cylinders, levers, head, rod, strict=True)
        )

    def friction(self, state: State) -> tuple[Node, ...]:
        """Compute efforts that change sign with the speed: see :func:`fitting.model.motion.friction`."""
        still = [0.0] * len(state.q)
        forward = self.efforts(State(state.q, state.qd, still, state.t))["tau"]
        back = self.efforts(State(state.q, [-v for v in state.qd], still, state.t))["tau"]
        return tuple(0.5 * (a - b) for a, b in zip(forward, back, strict=True))

    def _efforts(self, state: State, terms: Sequence[int], past: Past) -> dict[str, tuple[Node, ...]]:
        graph, model, n = self.graph, self.model, len(self.model.joints)
        if past == "settled":
            terms = [number for number in terms if not over_time(model.terms[number])]
        segment = self._segment([state])
        r = segment.r[0].tolist()
        columns: dict[int, Any] = {}
        drives: list[Node] = []
        for number, own in enumerate(model.passes):
            base = own.theta[model.parameters.base_slice]
            links = self._machine.links(state, base)
            loads = [tau / lever for tau, lever in zip(links, r, strict=True)]
            drives = [self._machine.drive(joint, own.theta, segment) + loads[joint] for joint in range(n)]
            for term in terms if columns else ():
                self._add(drives, term, own, columns[term])
            if number < len(model.passes) - 1 or number == 0:
                views = self._views(own, segment, drives, loads)
                columns = {term: self._columns(term, own, state, views, r, past) for term in terms}
                if len(model.passes) == 1:
                    for term in terms:
                        self._add(drives, term, own, columns[term])
        tau = tuple(graph.of(lever * force) for lever, force in zip(r, drives, strict=True))
        pressures = self._machine.pressures(model.passes[-1], segment, drives)
        return {"tau": tau, "force": tuple(graph.of(own) for own in drives)} | pressures

    def _add(self, drives: list[Node], number: int, own: Pass, columns: Any) -> None:
        """Add a term's part to the drives' efforts; a pass that had no terms yet has no parameters for it."""
        values = own.theta[self.model.term_slices[number]]
        for joint, own_columns in columns.items():
            if callable(own_columns):
                drives[joint] = drives[joint] + own_columns(values)
            elif len(values):
                for column, value in zip(own_columns, values, strict=True):
                    drives[joint] = drives[joint] + float(value) * column

    def _columns(
        self, number: int, own: Pass, state: State, views: Sequence[DriveView], r: Sequence[Value], past: Past
    ) -> dict[int, Any]:
        """Return a term's columns in one moment by joint, or the map to its part from its values."""
        term = self.model.terms[number]
        content = term.content
        if over_time(term):
            found = self._past(number)
            return {term.joint or 0: list(found.first if past == "first" else found.later)}
        if isinstance(content, Law) and not isinstance(content, Surface):
            return {term.joint or 0: self._law(term, content, views[term.joint or 0])}
        body = content.body_columns(self._arm, term.shape) if isinstance(content, Effect) else None
        if body is not None:
            sides = [self._body_column(column, own, state) for column in body]
            return {joint: [side[joint] / r[joint] for side in sides] for joint in range(len(r)) if sides}
        if isinstance(content, Effect) and term.everywhere:
            raise TypeError(f"{term.id} acts on all joints by numbers")
        return {term.joint or 0: list(np.asarray(term.columns(views), dtype=object)[0])}

    def _past(self, number: int) -> Remembered:
        """Return what a term remembers, and its columns."""
        term, graph, n = self.model.terms[number], self.graph, len(self.model.joints)
        if not over_time(term):
            return Remembered((), (), ())
        if number not in self._remembered:
            if term.everywhere or term.uses_model or isinstance(term.content, Law):
                raise TypeError(f"{term.id} needs more than the motion of its joint")
            marks = [f"@{k}" for k in range(MOMENTS)]
            states = [self.variables(mark) for mark in marks]
            bank: Any = SimpleNamespace(rate_hz=1.0 / graph.variable("dt"))
            views = self._views(self.model.passes[-1], self._segment(states), [None] * n, [None] * n, bank)
            columns = np.frompyfunc(graph.of, 1, 1)(np.asarray(term.columns(views), dtype=object))
            names = [f"{letter}{joint}" for letter in "qva" for joint in range(n)] + ["t"]
            moments = [{name: graph.variable(name + mark) for name in names} for mark in marks]
            taken = sum(len(own.memory) for own in self._remembered.values())
            self._remembered[number] = remembered(graph, columns.tolist(), moments, taken)
        return self._remembered[number]

    def _law(self, term: Term, law: Law, view: DriveView) -> Callable[[FloatArray], Value]:
        signal = np.asarray(law.values(view), dtype=object).ravel()[0]
        factor = law.factor(view.s[0])

        def part(values: FloatArray) -> Value:
            if not len(values):
                return 0.0
            return self.graph.curve(signal, spline_curve(np.asarray(law.knots), values)) * factor

        return part

    def _body_column(self, column: BodyColumn, own: Pass, state: State) -> Sequence[Value]:
        """Compute joint efforts of a change of the rigid body."""
        if column.links is None:
            still = [0.0] * len(state.q)
            base = own.theta[self.model.parameters.base_slice]
            tau: Sequence[Value] = self._machine.links(State(state.q, still, still, 0.0), base, column.gravity)
        else:
            tau = newton_euler(self.graph, self._machine.geometry, column.links, state, column.gravity)
        if column.since is None:
            return tau
        there = self.graph.binary("at_least", state.t, column.since)
        return [effort * there for effort in tau]

    def _segment(self, states: Sequence[State]) -> Segment:
        def rows(values: Any) -> Any:
            return traced(np.frompyfunc(self.graph.of, 1, 1)(np.array(values, dtype=object)))

        moved = [rows([getattr(state, word) for state in states]) for word in ("q", "qd", "qdd")]
        oil = rows([self.graph.variable("temperature")] * len(states))
        found = segment_of(self.model, moved, rows([state.t for state in states]), temperature=oil)
        return replace(found, **{word: rows(getattr(found, word)) for word in "xvar"})

    def _views(
        self, own: Pass, segment: Segment, drives: Sequence[Value], loads: Sequence[Value], bank: Any = None
    ) -> tuple[DriveView, ...]:
        """Return views of all joints; ``None`` among the forces is unavailable to terms."""

        def row(values: Sequence[Value]) -> Any:
            return traced([[value if value is None else self.graph.of(value) for value in values]])

        def pressures() -> Any:
            rods = enumerate(own.rods)
            return row([np.nan if law is None else self._machine.rod(law, segment, k, drives[k]) for k, law in rods])

        design = Design(self._arm, self.model.parameters, bank or self.model.bank, self.model.noise, (segment,), ())
        starts = {FOREIGN: 0.0}
        return views_of_segment(design, own.theta, segment, row(drives), row(loads), pressures, own.ranges, starts, ())


def tracer_of(model: ArmModel) -> Tracer:
    """Trace a model's expressions; where a term is in none, of the fit without it.

    Raises
    ------
    InputError
        If the machine has something that no format has.
    """
    found = Tracer(model)
    rest = model.rest(found.lost) if found.lost else None
    if rest is None:
        return found
    own = Tracer(rest)
    own.left_out = [*found.left_out, *refitted(model, rest)]
    return own


def untraced(model: ArmModel) -> frozenset[int]:
    """List the machine's terms that no format holds; none of a machine refused anyway."""
    try:
        return frozenset(Tracer(model).lost)
    except InputError:
        return frozenset()
