"""The model as one Python file that needs numpy only; also what hilfit itself simulates with."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.recordings.recording_files import replacing
from fitting.arm.expected import expected_power
from fitting.model.arm_model import ArmModel
from fitting.model.export.printing import Dialect, curves_of, statements
from fitting.model.export.tracing.graph import Curve, Node
from fitting.model.export.tracing.moment import State
from fitting.model.export.tracing.tracing import Tracer
from fitting.model.export.words import Written, heading

FloatArray = npt.NDArray[np.float64]

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

_HELPERS = '''
def above(a, b):
    return np.greater(a, b) * 1.0


def at_least(a, b):
    return np.greater_equal(a, b) * 1.0


def _kummer(a, z):
    """Kummer's M(a, 3/2, z) for z >= 0: a sum of positive terms."""
    term = np.ones_like(z)
    total = np.ones_like(z)
    for k in range(200):
        term = term * ((a + k) / (1.5 + k) / (k + 1.0)) * z
        total = total + term
        if np.all(term <= 1e-17 * total):
            break
    return total


def erf(x):
    """Error function: 2 x / sqrt(pi) exp(-x^2) M(1, 3/2, x^2)."""
    x = np.asarray(x, dtype=float)
    inside = np.clip(x, -6.0, 6.0)
    square = inside * inside
    return np.where(np.abs(x) < 6.0, 1.1283791670955126 * inside * np.exp(-square) * _kummer(1.0, square), np.sign(x))


def signed_power(v, noise, p, factor):
    """Expectation of |v|^p sgn v of a speed v that was measured with normal noise."""
    v = np.asarray(v, dtype=float)
    far = np.abs(v) ** p * np.sign(v)
    if noise <= 0.0:
        return far
    u = v / noise
    near = np.abs(u) < 6.0
    inverse = 1.0 / np.where(near, 1.0, u) ** 2
    far = far * (1.0 + p * (p - 1.0) / 2.0 * inverse * (1.0 + (p - 2.0) * (p - 3.0) / 4.0 * inverse))
    if not np.any(near):
        return far
    inside = np.where(near, u, 0.0)
    z = 0.5 * inside * inside
    return np.where(near, factor * inside * np.exp(-z) * _kummer(1.0 + p / 2.0, z), far)


def curve(x, breaks, pieces):
    """Piecewise cubic, constant beyond its ends."""
    inside = np.clip(x, breaks[0], breaks[-1])
    k = np.clip(np.searchsorted(breaks, inside, side="right") - 1, 0, len(pieces) - 1)
    d = inside - breaks[k]
    c = pieces[k]
    return ((c[..., 0] * d + c[..., 1]) * d + c[..., 2]) * d + c[..., 3]
'''


def _rows(name: str, arguments: str, joints: int, letters: str, lines: list[str], words: list[str]) -> str:
    """A function on arrays (N, n)."""
    given = {"q": "q", "v": "qd", "a": "qdd"}
    first = [f"    {given[letter]} = np.asarray({given[letter]}, dtype=float)" for letter in letters]
    unpacked = [
        f"    {', '.join(f'{letter}{j}' for j in range(joints))}{',' if joints == 1 else ''} = "
        f"({', '.join(f'{given[letter]}[..., {j}]' for j in range(joints))}{',' if joints == 1 else ''})"
        for letter in letters
    ]
    still = "np.zeros(np.shape(q)[:-1])"
    result = [f"    return np.stack([{', '.join(f'{word} + {still}' for word in words)}], axis=-1)"]
    return "\n".join([f"def {name}({arguments}):", *first, *unpacked, *lines, *result])


def write_python(model: ArmModel, path: Path) -> Written:
    """Write the model as a Python module."""
    tracer = Tracer(model)
    text = python_source(tracer)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Written((path,), tuple(tracer.left_out))


def python_source(tracer: Tracer) -> str:
    """Text of the module."""
    state, n = tracer.variables(), len(tracer.model.joints)
    found = tracer.efforts(state)
    named = {f"{letter}{j}": f"{letter}{j}" for j in range(n) for letter in "qva"} | {"t": "t"}
    groups: list[tuple[str, str, str, list[Node]]] = [
        ("inverse_dynamics", "q, qd, qdd, t=0.0", "qva", list(found.joint)),
        ("drive_efforts", "q, qd, qdd, t=0.0", "qva", list(found.drive)),
        ("gravity", "q", "q", list(tracer.gravity(state.q))),
        ("friction", "q, qd, t=0.0", "qv", list(tracer.friction(state))),
    ]
    if all(node is not None for node in (*found.head, *found.rod)):
        groups.append(("head_pressures", "q, qd, qdd, t=0.0", "qva", [node for node in found.head if node is not None]))
        groups.append(("rod_pressures", "q, qd, qdd, t=0.0", "qva", [node for node in found.rod if node is not None]))
    functions = []
    for name, arguments, letters, nodes in groups:
        lines, words = statements({str(k): node for k, node in enumerate(nodes)}, DIALECT, named)
        functions.append(_rows(name, arguments, n, letters, lines, [words[str(k)] for k in range(len(nodes))]))
    tables = [
        f"    {number}: (np.array({curve.breaks.tolist()!r}), np.array({curve.pieces.tolist()!r})),"
        for number, curve in enumerate(tracer.graph.curves)
        if number in set(curves_of([node for group in groups for node in group[3]]))
    ]
    head = '"""' + "\n".join(heading(tracer)) + '\n"""\n'
    imports = (
        "\nimport numpy as np\nfrom numpy import cos, exp, expm1, hypot, maximum, minimum, sign, sin, sqrt, tanh\n"
    )
    constants = f"\nJOINTS = {list(tracer.model.joints)!r}\nCURVES = {{\n" + "\n".join([*tables, "}"]) + "\n"
    body = "\n\n\n".join(functions)
    return f"{head}{imports}{constants}\n{_HELPERS}\n\n{body}\n"


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
