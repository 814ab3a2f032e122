"""A model as expressions of one moment: position, speed and acceleration of every joint, and the time.

The rigid body is Newton's and Euler's recursion (:mod:`~fitting.model.export.tracing.recursion`) with the base
parameters on their own columns (the other standard parameters are zero). Drives and linkages are written out
(:mod:`~fitting.model.export.tracing.machine_nodes`). Effects and laws are *traced*: their own code runs on arrays of
nodes instead of numbers (:mod:`~fitting.model.export.tracing.traced_arrays`), so no formula exists twice. One that
has a history is traced at some moments at once and becomes a recurrence
(:mod:`~fitting.model.export.tracing.memory`). A term that cannot be traced (a derivative, a formula that asks for
numbers) is named and left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np

from daq.errors import InputError
from daq.machine.linkages import FourBar, reduced
from fitting.arrays import FloatArray
from fitting.effects.base import BodyColumn, Effect
from fitting.model.arm_model import FOREIGN, ArmModel, Pass, of_sensors, over_time, phase_unknown
from fitting.model.evaluation import beyond, without
from fitting.model.export.tracing.graph import Graph, Node, spline_curve
from fitting.model.export.tracing.machine_nodes import MachineNodes
from fitting.model.export.tracing.memory import MOMENTS, Memory, Remembered, remembered
from fitting.model.export.tracing.moment import Efforts, State, Value
from fitting.model.export.tracing.recursion import newton_euler
from fitting.model.export.tracing.traced_arrays import TracedView, traced
from fitting.model.export.words import refitted
from fitting.residual.laws import Law
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.signals.preparation import Segment

#: What terms with a history say: nothing (settled), what they say at a motion's first moment, or at a later one.
Past = Literal["settled", "first", "later"]


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
        self._machine, self._arm = MachineNodes(model, self.graph), model.arm
        self._remembered: dict[int, Remembered] = {}
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

    @property
    def memory(self) -> tuple[Memory, ...]:
        """What has to be kept from moment to moment."""
        return tuple(own for number in self._terms for own in self._past(number).memory)

    def variables(self, mark: str = "") -> State:
        """A moment that is known at run time: variables ``q0 ...``, ``v0 ...``, ``a0 ...`` and ``t``."""
        n = range(len(self.model.joints))
        q, qd, qdd = ([self.graph.variable(f"{letter}{joint}{mark}") for joint in n] for letter in "qva")
        return State(q, qd, qdd, self.graph.variable(f"t{mark}"))

    def _traceable(self) -> list[int]:
        """Numbers of the terms that can be traced; the others are noted."""
        model, kept = self.model, list[int]()
        variables = self.variables()
        for number, term in enumerate(model.terms):
            name = "a law" if isinstance(term.content, Law) else term.content.title
            if of_sensors(term):
                why = "it belongs to the sensors"
            elif phase_unknown(term, FOREIGN):
                why = "its phase belongs to single recordings"
            elif isinstance(term.content, Law) and any(s == "oil_temperature" for s, _ in term.content.signals):
                why = "it needs the oil's temperature"
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

    def efforts(self, state: State, past: Past = "settled") -> Efforts:
        """Efforts and pressures of a moment; with a past only of that of :meth:`variables`."""
        return self._efforts(state, self._terms, past)

    def gravity(self, q: Sequence[Value]) -> tuple[Node, ...]:
        """Joint efforts that hold the arm still: see :func:`fitting.model.motion.gravity`."""
        still = [0.0] * len(q)
        return self.efforts(State(q, still, still, 0.0)).joint

    def beyond(self, state: State) -> tuple[Node, ...]:
        """1 of each joint that is beyond what was recorded: see :func:`fitting.model.evaluation.beyond`."""
        return tuple(beyond(self.model, self._segment([state]))[0])

    def friction(self, state: State) -> tuple[Node, ...]:
        """Joint efforts that change their sign with the speed's: see :func:`fitting.model.motion.friction`."""
        still = [0.0] * len(state.q)
        forward = self.efforts(State(state.q, state.qd, still, state.t)).joint
        back = self.efforts(State(state.q, [-v for v in state.qd], still, state.t)).joint
        return tuple(0.5 * (a - b) for a, b in zip(forward, back, strict=True))

    def _efforts(self, state: State, terms: Sequence[int], past: Past) -> Efforts:
        graph, model, n = self.graph, self.model, len(self.model.joints)
        if past == "settled":
            terms = [number for number in terms if not over_time(model.terms[number])]
        x, v, a, r = self._pistons(state)
        segment = self._segment([state])
        columns: dict[int, Any] = {}
        drives: list[Node] = []
        for number, own in enumerate(model.passes):
            base = own.theta[model.parameters.base_slice]
            links = self._machine.links(state, base)
            loads = [tau / lever for tau, lever in zip(links, r, strict=True)]
            drives = [
                self._machine.drive(joint, own.theta, x[joint], v[joint], a[joint]) + loads[joint] for joint in range(n)
            ]
            for term in terms if columns else ():
                self._add(drives, term, own, columns[term])
            if number < len(model.passes) - 1 or number == 0:
                views = self._views(own, segment, drives, loads)
                columns = {term: self._columns(term, own, state, views, r, past) for term in terms}
                if len(model.passes) == 1:
                    for term in terms:
                        self._add(drives, term, own, columns[term])
        head, rod = self._machine.pressures(model.passes[-1], segment, drives)
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
        self, number: int, own: Pass, state: State, views: Sequence[TracedView], r: Sequence[Value], past: Past
    ) -> dict[int, Any]:
        """Columns of a term in one moment by joint, or what makes its part of them from its values."""
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
        """What a term remembers, and its columns."""
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

    def _law(self, term: Term, law: Law, view: TracedView) -> Callable[[FloatArray], Value]:
        signal = np.asarray(law.values(view), dtype=object).ravel()[0]
        factor = law.factor(view.s[0])

        def part(values: FloatArray) -> Value:
            if not len(values):
                return 0.0
            return self.graph.curve(signal, spline_curve(np.asarray(law.knots), values)) * factor

        return part

    def _body_column(self, column: BodyColumn, own: Pass, state: State) -> Sequence[Value]:
        """Joint efforts of a change of the rigid body."""
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

    def _pistons(self, state: State) -> list[tuple[Value, ...]]:
        """Positions, speeds and accelerations of all drives, and their lever arms."""
        return list(zip(*(self._machine.piston(joint, state) for joint in range(len(state.q))), strict=True))

    def _segment(self, states: Sequence[State]) -> Segment:
        def rows(values: Sequence[Sequence[Value]]) -> Any:
            return traced([[self.graph.of(value) for value in row] for row in values])

        time: Any = traced([self.graph.of(state.t) for state in states])
        x, v, a, r = (rows(own) for own in zip(*(self._pistons(state) for state in states), strict=True))
        unknown = np.full(x.shape, np.nan)
        return Segment(
            recording=FOREIGN,
            role="operation",
            start=0,
            t=time,
            q=rows([state.q for state in states]),
            qd=rows([state.qd for state in states]),
            qdd=rows([state.qdd for state in states]),
            x=x,
            v=v,
            a=a,
            r=r,
            effort=unknown,
            p1=unknown,
            p2=unknown,
            rest=np.zeros(x.shape, dtype=bool),
            loaded=True,
            temperature=None,
            gap=unknown,
        )

    def _views(
        self, own: Pass, segment: Segment, drives: Sequence[Value], loads: Sequence[Value], bank: Any = None
    ) -> tuple[TracedView, ...]:
        """Views of all joints; ``None`` among the forces is one that no term may ask for."""

        def row(values: Sequence[Value]) -> Any:
            return traced([[value if value is None else self.graph.of(value) for value in values]])

        return tuple(
            TracedView(
                machine=self._arm,
                joint=joint,
                segment=segment,
                bank=bank or self.model.bank,
                noise=self.model.noise,
                forces=row(drives),
                loads=row(loads),
                rod_pressures=lambda: row(
                    [
                        float("nan") if law is None else self._machine.rod(law, segment, j, drives[j])
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


def tracer_of(model: ArmModel) -> Tracer:
    """Expressions of a model; where a term is in none, of the fit without it.

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
    """Numbers of the machine's terms that no format holds; none of a machine that is refused anyway."""
    try:
        return frozenset(Tracer(model).lost)
    except InputError:
        return frozenset()
