"""The model as one Python file that needs numpy only; also what hilfit itself simulates with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from daq.recordings.recording_files import replacing
from fitting.arm.expected import expected_power
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import ARRAYS, Function, functions_of, rendered
from fitting.model.export.printing import Dialect, curves_of, statements
from fitting.model.export.tracing.graph import Curve, Node
from fitting.model.export.tracing.moment import State
from fitting.model.export.tracing.tracing import Tracer, tracer_of
from fitting.model.export.words import Written, heading

#: Noise widths beyond which :func:`fitting.arm.expected.expected_power` takes its asymptotic series.
_FAR = 6.0

DIALECT = Dialect(
    functions={
        "abs": "np.abs",
        "max": "maximum",
        "min": "minimum",
        "above": "above",
        "at_least": "at_least",
        "sign": "sign",
        "power": "({0} ** {1})",
        "signed_power": "signed_power",
        "curve": "curve({0}, *CURVES[{1}])",
    }
)


def write_python(model: ArmModel, path: Path) -> Written:
    """Write the model as a Python module."""
    tracer = tracer_of(model)
    text = python_source(tracer)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Written((path,), tuple(tracer.left_out))


def python_source(tracer: Tracer) -> str:
    """Text of the module."""
    functions = list[Function]()
    for own in functions_of(tracer):  # a function has one value, but for what is kept beside it
        apart = own.name == "pressures"
        functions += (
            [Function(f"{k}_pressures", own.arguments, {k: v}) for k, v in own.outputs.items()] if apart else [own]
        )
    used = curves_of([node for own in functions for node in own.nodes])
    return rendered(
        "arm.py.j2",
        said=heading(tracer),
        joints=list(tracer.model.joints),
        curves=[
            {
                "number": k,
                "breaks": tracer.graph.curves[k].breaks.tolist(),
                "pieces": tracer.graph.curves[k].pieces.tolist(),
            }
            for k in used
        ],
        functions=[_function(own) for own in functions],
    )


def _function(own: Function) -> dict[str, Any]:
    """A function on arrays (N, n)."""
    given = [word for word in own.arguments if word in ARRAYS]
    lines, words = own.body(DIALECT, lambda array, k: f"{ARRAYS[array]}{k}")
    asked = own.variables(lambda array, k: f"{ARRAYS[array]}{k}")
    first = [f"{word} = np.asarray({word}, dtype=float)" for word in given]
    first += [f"{name} = {word}[..., {name[1:]}]" for word in given for name in asked if name[0] == ARRAYS[word]]
    late = own.arguments[-1] == "t"  # what is one of several moments has a time
    arguments = ", ".join("t=0.0" if word == "t" and late else word for word in own.arguments)
    results = [f"np.stack([{', '.join(f'{word} + still' for word in own)}], axis=-1)" for own in words.values()]
    body = [*first, "still = np.zeros(q.shape[:-1])", *lines]
    return {"name": own.name, "arguments": arguments, "body": body, "results": results}


@dataclass(frozen=True)
class Compiled:
    """Functions of single moments, for a simulation: lists of numbers in, lists of numbers out.

    Attributes
    ----------
    effort : ``(q, qd, qdd, t)`` to joint efforts
    inertia : ``(q,)`` to the inertia matrix at rest, column by column
    """

    effort: Callable[[Any, Any, Any, float], list[float]]
    inertia: Callable[[Any], list[float]]


def compiled(tracer: Tracer) -> Compiled:
    """Make the model's efforts and its inertia functions of Python."""
    state, n = tracer.variables(), len(tracer.model.joints)
    still = [0.0] * n
    rest = tracer.efforts(State(state.q, still, still, state.t)).joint
    inertia: list[Node] = []
    for j in range(n):
        unit = [1.0 if k == j else 0.0 for k in range(n)]
        pushed = tracer.efforts(State(state.q, still, unit, state.t)).joint
        inertia += [a - b for a, b in zip(pushed, rest, strict=True)]
    curves = tracer.graph.curves
    namespace: dict[str, Any] = {
        **{name: getattr(math, name) for name in ("cos", "exp", "expm1", "hypot", "sin", "sqrt", "tanh", "erf")},
        "np": np,
        "maximum": max,
        "minimum": min,
        "above": lambda a, b: float(a > b),
        "at_least": lambda a, b: float(a >= b),
        "sign": lambda x: float((x > 0) - (x < 0)),
        "signed_power": _scalar_power,
        "curve": _scalar_curve,
        "CURVES": {k: (own,) for k, own in enumerate(curves)},
    }
    functions = (
        ("effort", "q, qd, qdd, t", tracer.efforts(state).joint, {"q": "q", "v": "qd", "a": "qdd"}),
        ("inertia", "q, t=0.0", tuple(inertia), {"q": "q"}),
    )
    for name, arguments, nodes, letters in functions:
        named = {f"{letter}{j}": f"{of}[{j}]" for letter, of in letters.items() for j in range(n)} | {"t": "t"}
        lines, words = statements({str(k): node for k, node in enumerate(nodes)}, DIALECT, named)
        result = f"    return [{', '.join(words[str(k)] for k in range(len(nodes)))}]"
        exec("\n".join([f"def {name}({arguments}):", *lines, result]), namespace)  # our own text, from numbers
    return Compiled(namespace["effort"], namespace["inertia"])


def _scalar_power(v: float, noise: float, p: float, factor: float) -> float:
    if noise > 0 and abs(v) < _FAR * noise:
        return float(expected_power(np.array([v]), noise, p)[0])
    inverse = (noise / v) ** 2 if v else 0.0
    series = 1.0 + p * (p - 1.0) / 2.0 * inverse * (1.0 + (p - 2.0) * (p - 3.0) / 4.0 * inverse)
    return math.copysign(abs(v) ** p * series, v)


def _scalar_curve(x: float, own: Curve) -> float:
    inside = min(max(x, own.breaks[0]), own.breaks[-1])
    k = min(max(int(np.searchsorted(own.breaks, inside, side="right")) - 1, 0), len(own.pieces) - 1)
    d, c = inside - own.breaks[k], own.pieces[k]
    return float(((c[0] * d + c[1]) * d + c[2]) * d + c[3])
