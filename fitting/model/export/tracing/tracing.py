"""A model as expressions of one moment: position, speed and acceleration of every joint, and the time.

The rigid body is Newton's and Euler's recursion (:mod:`~fitting.model.export.tracing.recursion`) with the base
parameters on their own columns (the other standard parameters are zero). Drives and linkages are written out
(:mod:`~fitting.model.export.tracing.machine_nodes`). Effects and laws are *traced*: their own code runs on arrays of
nodes instead of numbers (:mod:`~fitting.model.export.tracing.traced_arrays`), so no formula exists twice. A term that
cannot be traced (a history, a derivative, a formula that asks for numbers) is named and left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.errors import InputError
from daq.machine.linkages import FourBar, reduced
from fitting.effects.base import BodyColumn, Effect
from fitting.model.arm_model import FOREIGN, ArmModel, Pass, over_time, phase_unknown
from fitting.model.evaluation import without
from fitting.model.export.tracing.graph import Graph, Node, spline_curve
from fitting.model.export.tracing.machine_nodes import MachineNodes
from fitting.model.export.tracing.moment import Efforts, State, Value
from fitting.model.export.tracing.recursion import newton_euler
from fitting.model.export.tracing.traced_arrays import TracedView, traced
from fitting.residual.laws import Law
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.signals.preparation import Segment

FloatArray = npt.NDArray[np.float64]


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
        self._machine, self._arm = MachineNodes(model, self.graph), model.arm
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
            if term.delays_effort:
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
        return self._machine.links(State(q, still, still, 0.0), self.model.theta[self.model.parameters.base_slice])

    def friction(self, state: State) -> tuple[Node, ...]:
        """Joint efforts that change their sign with the speed's: see :func:`fitting.model.motion.friction`."""
        still = [0.0] * len(state.q)
        forward = self.efforts(State(state.q, state.qd, still, state.t)).joint
        back = self.efforts(State(state.q, [-v for v in state.qd], still, state.t)).joint
        return tuple(0.5 * (a - b) for a, b in zip(forward, back, strict=True))

    def _efforts(self, state: State, terms: Sequence[int]) -> Efforts:
        graph, model, n = self.graph, self.model, len(self.model.joints)
        x, v, a, r = zip(*(self._machine.piston(joint, state) for joint in range(n)), strict=True)
        segment = self._segment(state, x, v, a, r)
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
                columns = {term: self._columns(term, own, state, views, r) for term in terms}
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
        self, number: int, own: Pass, state: State, views: Sequence[TracedView], r: Sequence[Value]
    ) -> dict[int, Any]:
        """Columns of a term in one moment by joint, or what makes its part of them from its values."""
        term = self.model.terms[number]
        content = term.content
        if isinstance(content, Law) and not isinstance(content, Surface):
            return {term.joint or 0: self._law(term, content, views[term.joint or 0])}
        body = content.body_columns(self._arm, term.shape) if isinstance(content, Effect) else None
        if body is not None:
            sides = [self._body_column(column, own, state) for column in body]
            return {joint: [side[joint] / r[joint] for side in sides] for joint in range(len(r)) if sides}
        if isinstance(content, Effect) and term.everywhere:
            raise TypeError(f"{term.id} acts on all joints by numbers")
        found = np.asarray(term.columns(views), dtype=object)
        return {term.joint or 0: list(found[0])}

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

    def _views(
        self, own: Pass, segment: Segment, drives: Sequence[Value], loads: Sequence[Value]
    ) -> tuple[TracedView, ...]:
        def row(values: Sequence[Value]) -> Any:
            return traced([[self.graph.of(value) for value in values]])

        return tuple(
            TracedView(
                machine=self._arm,
                joint=joint,
                segment=segment,
                bank=self.model.bank,
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
