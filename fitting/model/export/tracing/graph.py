"""Expressions of a model as one graph without duplicates, to be printed in any language.

A :class:`Node` is a number, a variable, or an operation on nodes. A :class:`Graph` gives the same node for the same
operation, so a common subexpression is computed once; zeros and ones are folded away. Nodes have Python's arithmetic
and the methods that numpy calls on objects, so code that is written for arrays runs on arrays of nodes
(:mod:`fitting.model.export.tracing.tracing`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy

from fitting.arrays import FloatArray

#: A number or a node.
Value = Any

#: Operations that any language has a word for, and what they do to numbers.
UNARY: dict[str, Callable[[float], float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "expm1": math.expm1,
    "tanh": math.tanh,
    "sqrt": math.sqrt,
    "abs": abs,
    "erf": math.erf,
    "sign": lambda x: float((x > 0) - (x < 0)),
    "neg": lambda x: -x,
}
BINARY: dict[str, Callable[[float, float], float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "max": max,
    "min": min,
    "above": lambda a, b: float(a > b),
    "at_least": lambda a, b: float(a >= b),
    "hypot": math.hypot,
    "power": lambda a, b: a**b,
}


def _unary(operation: str) -> Callable[[Any], Any]:
    """Make a method that makes a node of one."""
    return lambda self: self.graph.unary(operation, self)


def _binary(operation: str, *, turned: bool = False) -> Callable[[Any, Any], Any]:
    """Make a method that makes a node of two, the other and this one if they are turned."""
    if turned:
        return lambda self, other: self.graph.binary(operation, other, self)
    return lambda self, other: self.graph.binary(operation, self, other)


class Node:
    """A number, a variable, or an operation; made by a :class:`Graph` only."""

    __slots__ = ("arguments", "graph", "number", "operation", "value")

    def __init__(
        self, graph: Graph, number: int, operation: str, arguments: tuple[Node, ...], value: float | str | None
    ) -> None:
        self.graph, self.number, self.operation = graph, number, operation
        self.arguments, self.value = arguments, value

    def is_number(self, value: float) -> bool:
        """Return whether this is the number ``value``."""
        return self.operation == "number" and self.value == value

    def __bool__(self) -> bool:
        raise TypeError("what this depends on is known only at run time")

    def __float__(self) -> float:
        if self.operation == "number":
            assert isinstance(self.value, float)
            return self.value
        raise TypeError("this is known only at run time")

    # Python's signs, and the names by which numpy asks objects for its functions: one line for each operation.
    __add__, __radd__ = _binary("add"), _binary("add", turned=True)
    __sub__, __rsub__ = _binary("sub"), _binary("sub", turned=True)
    __mul__, __rmul__ = _binary("mul"), _binary("mul", turned=True)
    __truediv__, __rtruediv__ = _binary("div"), _binary("div", turned=True)
    __gt__, __lt__ = _binary("above"), _binary("above", turned=True)
    __ge__, __le__ = _binary("at_least"), _binary("at_least", turned=True)
    __pow__, hypot = _binary("power"), _binary("hypot")
    __neg__, __abs__, sqrt = _unary("neg"), _unary("abs"), _unary("sqrt")
    sin, cos, tanh, exp, expm1 = (_unary(name) for name in ("sin", "cos", "tanh", "exp", "expm1"))


@dataclass(frozen=True)
class Curve:
    """A piecewise cubic, constant beyond its ends.

    Attributes
    ----------
    breaks : (m + 1,) where pieces begin and end
    pieces : (m, 4) coefficients of each from its own beginning on, the cube's first
    """

    breaks: FloatArray
    pieces: FloatArray

    def at(self, x: float) -> float:
        """Return its value."""
        inside = min(max(x, self.breaks[0]), self.breaks[-1])
        piece = min(int(np.searchsorted(self.breaks, inside, side="right")) - 1, len(self.pieces) - 1)
        d, c = inside - self.breaks[piece], self.pieces[piece]
        return float(((c[0] * d + c[1]) * d + c[2]) * d + c[3])


def spline_curve(knots: FloatArray, values: FloatArray) -> Curve:
    """Return a cubic spline as pieces."""
    pieces = scipy.interpolate.PPoly.from_spline((knots, values, 3))
    inside = np.diff(pieces.x) > 0
    return Curve(np.append(pieces.x[:-1][inside], pieces.x[-1]), pieces.c[:, inside].T)


@dataclass
class Graph:
    """Nodes by what they are, in the order in which they were made: arguments come first."""

    nodes: list[Node] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    _numbers: dict[tuple[bytes, bytes], int] = field(default_factory=dict, repr=False)
    _known: dict[tuple[Any, ...], Node] = field(default_factory=dict, repr=False)

    def node(self, operation: str, arguments: tuple[Node, ...] = (), value: float | str | None = None) -> Node:
        """Return the one node that is this."""
        key = (operation, tuple(a.number for a in arguments), value)
        if key not in self._known:
            self._known[key] = Node(self, len(self.nodes), operation, arguments, value)
            self.nodes.append(self._known[key])
        return self._known[key]

    def number(self, value: float) -> Node:
        """Return a number; there is no negative zero."""
        return self.node("number", (), float(value) + 0.0)

    def variable(self, name: str) -> Node:
        """Return a variable."""
        return self.node("variable", (), name)

    def curve(self, x: Any, curve: Curve) -> Node:
        """Return a piecewise cubic of ``x``."""
        if self.of(x).operation == "number":
            return self.number(curve.at(float(self.of(x))))
        key = (curve.breaks.tobytes(), curve.pieces.tobytes())
        if key not in self._numbers:
            self._numbers[key] = len(self.curves)
            self.curves.append(curve)
        return self.node("curve", (self.of(x),), str(self._numbers[key]))

    def signed_power(self, speed: Any, noise: float, exponent: float) -> Node:
        """Return ``E[|v|^p sgn v]`` of a noisy speed: see :func:`fitting.arm.expected.expected_power`."""
        if self.of(speed).is_number(0.0):
            return self.number(0.0)
        return self.node("signed_power", (self.of(speed), self.number(noise), self.number(exponent)))

    def of(self, value: Any) -> Node:
        """Return a node as it is, a number as a node."""
        return value if isinstance(value, Node) else self.number(float(value))

    def unary(self, operation: str, value: Any) -> Node:
        """Return an operation on one node."""
        a = self.of(value)
        if a.operation == "number":
            return self.number(UNARY[operation](float(a)))
        if operation == "neg" and a.operation == "neg":
            return a.arguments[0]
        if operation in ("sin", "cos") and a.operation == "add":
            for angle, offset in (a.arguments, a.arguments[::-1]):
                if offset.operation == "number":  # a joint's sine and cosine serve its link and its linkage alike
                    return self._turned(operation, angle, float(offset))
        return self.node(operation, (a,))

    def _turned(self, operation: str, angle: Node, by: float) -> Node:
        """Return sine or cosine of a sum by those of an angle."""
        sine, cosine = self.unary("sin", angle), self.unary("cos", angle)
        if operation == "sin":
            return self.of(sine * math.cos(by) + cosine * math.sin(by))
        return self.of(cosine * math.cos(by) - sine * math.sin(by))

    def binary(self, operation: str, a: Any, b: Any) -> Node:
        """Return an operation on two nodes."""
        a, b = self.of(a), self.of(b)
        if a.operation == "number" and b.operation == "number":
            return self.number(BINARY[operation](float(a), float(b)))
        folded = self._folded(operation, a, b)
        if folded is not None:
            return folded
        if operation in ("add", "mul") and a.number > b.number:  # a b and b a are one node
            a, b = b, a
        return self.node(operation, (a, b))

    def _folded(self, operation: str, a: Node, b: Node) -> Node | None:
        """Return what is simpler than the operation; None if nothing is."""
        if operation == "add":
            if a.is_number(0.0) or b.is_number(0.0):
                return b if a.is_number(0.0) else a
            if b.operation == "neg":
                return self.binary("sub", a, b.arguments[0])
            if a.operation == "neg":
                return self.binary("sub", b, a.arguments[0])
        elif operation == "sub":
            if b.is_number(0.0):
                return a
            if a.is_number(0.0):
                return self.unary("neg", b)
            if a is b:
                return self.number(0.0)
            if b.operation == "neg":
                return self.binary("add", a, b.arguments[0])
        elif operation == "mul":
            for one, other in ((a, b), (b, a)):
                if one.is_number(0.0):
                    return one
                if one.is_number(1.0):
                    return other
                if one.is_number(-1.0):
                    return self.unary("neg", other)
        elif operation == "div":
            if a.is_number(0.0) or b.is_number(1.0):
                return a
        elif operation == "power":
            exponent = float(b) if b.operation == "number" else -1.0
            if exponent in (0.0, 1.0, 2.0, 3.0):
                product = self.number(1.0)
                for _ in range(int(exponent)):
                    product = self.binary("mul", a, product)
                return product
        return None


def needed(outputs: Iterable[Node]) -> list[Node]:
    """List all nodes that some outputs are made of, arguments first."""
    found: dict[int, Node] = {}
    todo = list(outputs)
    while todo:
        node = todo.pop()
        if node.number not in found:
            found[node.number] = node
            todo += node.arguments
    return [found[number] for number in sorted(found)]


def uses(nodes: Sequence[Node], outputs: Sequence[Node]) -> dict[int, int]:
    """Count how often each node is an argument or an output."""
    counts = dict.fromkeys((node.number for node in nodes), 0)
    for node in nodes:
        for argument in node.arguments:
            counts[argument.number] += 1
    for node in outputs:
        counts[node.number] += 1
    return counts


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
        elif ufunc.__name__ in ("sign", "erf"):
            result = np.frompyfunc(lambda a: graph.unary(ufunc.__name__, a), 1, 1)(*plain)
        elif ufunc.__name__ == "clip":
            result = np.frompyfunc(lambda a, b, c: graph.binary("min", graph.binary("max", a, b), c), 3, 1)(*plain)
        elif method != "__call__" or kwargs:
            raise TypeError(f"{ufunc.__name__} cannot be traced")
        else:
            objects = [np.frompyfunc(graph.of, 1, 1)(array) for array in plain]
            result = ufunc(*objects)
        return traced(result)

    def expected_power(self, noise: float, exponent: float) -> Any:
        """Return expected signed powers: see :func:`fitting.arm.expected.expected_power`."""
        return traced(
            np.frompyfunc(lambda v: v.graph.signed_power(v, max(noise, 0.0), exponent), 1, 1)(np.asarray(self))
        )

    def astype(self, *args: Any, **kwargs: Any) -> Any:
        """Return the same: nodes are numbers of every kind."""
        return self


def traced(values: Any) -> Traced:
    """Return nodes as an array that effects can calculate with."""
    return np.asarray(values, dtype=object).view(Traced)


def sign(graph: Graph, speed: Value, noise: float) -> Node:
    """Return the expected sign: see :func:`fitting.arm.expected.expected_sign`."""
    speed = graph.of(speed)
    if noise <= 0:
        return graph.unary("sign", speed)
    return graph.unary("erf", speed / (np.sqrt(2.0) * noise))
