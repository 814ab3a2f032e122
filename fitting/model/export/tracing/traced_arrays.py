"""Arrays of nodes that numpy and effects calculate with as if they were numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fitting.model.export.tracing.graph import Graph, Node
from fitting.model.export.tracing.recursion import Value

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
        """Expected signed powers of speeds: see :func:`fitting.arm.expected.expected_power`."""
        return traced(
            np.frompyfunc(lambda v: v.graph.signed_power(v, max(noise, 0.0), exponent), 1, 1)(np.asarray(self))
        )

    def astype(self, *args: Any, **kwargs: Any) -> Any:
        """The same: nodes are numbers of every kind."""
        return self


def traced(values: Any) -> Traced:
    """Nodes as an array that effects can calculate with."""
    return np.asarray(values, dtype=object).view(Traced)


def sign(graph: Graph, speed: Value, noise: float) -> Node:
    """Expected sign of a speed: see :func:`fitting.arm.expected.expected_sign`."""
    speed = graph.of(speed)
    if noise <= 0:
        return graph.unary("sign", speed)
    return graph.unary("erf", speed / (np.sqrt(2.0) * noise))
