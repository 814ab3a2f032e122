"""The model as Python functions of single moments, for a simulation: lists of numbers in, lists of numbers out."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import hyp1f1

from fitting.model.export.functions import indexed, moving_functions
from fitting.model.export.printing import PYTHON
from fitting.model.export.tracing.graph import Curve
from fitting.model.export.tracing.tracing import Tracer

#: Noise widths beyond which :func:`fitting.arm.expected.expected_power` takes its asymptotic series.
_FAR = 6.0


def compiled(tracer: Tracer) -> dict[str, Callable[..., list[float]]]:
    """Make :func:`~fitting.model.export.functions.moving_functions` functions of Python, by name."""
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
        "CURVES": {k: (own,) for k, own in enumerate(tracer.graph.curves)},
    }
    functions = moving_functions(tracer)
    for own in functions:
        lines, words = own.body(PYTHON, indexed)
        (result,) = words.values()
        text = [f"def {own.name}({', '.join(own.arguments)}):", *lines, f"return [{', '.join(result)}]"]
        exec("\n    ".join(text), namespace)  # our own text, from numbers
    return {own.name: namespace[own.name] for own in functions}


def _scalar_power(v: float, noise: float, p: float, factor: float) -> float:
    if noise > 0 and abs(v) < _FAR * noise:
        u = v / noise
        return factor * u * float(hyp1f1((1.0 - p) / 2.0, 1.5, -0.5 * u * u))
    inverse = (noise / v) ** 2 if v else 0.0
    series = 1.0 + p * (p - 1.0) / 2.0 * inverse * (1.0 + (p - 2.0) * (p - 3.0) / 4.0 * inverse)
    return math.copysign(abs(v) ** p * series, v)


def _scalar_curve(x: float, own: Curve) -> float:
    inside = min(max(x, own.breaks[0]), own.breaks[-1])
    k = min(max(int(np.searchsorted(own.breaks, inside, side="right")) - 1, 0), len(own.pieces) - 1)
    d, c = inside - own.breaks[k], own.pieces[k]
    return float(((c[0] * d + c[1]) * d + c[2]) * d + c[3])
