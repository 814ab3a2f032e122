"""Graphs as statements of a language: one temporary per value that is used twice, the rest in place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import scipy

from fitting.model.export.tracing.graph import Node, needed, uses

#: Operations nested in one statement at most: long lines are hard on compilers and readers alike.
_DEEPEST = 6
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}


@dataclass(frozen=True)
class Dialect:
    """Words of a language.

    Attributes
    ----------
    declare : what is before a temporary's name
    assign : sign between a name and its value
    end : what ends a statement
    functions : names of functions and, with ``{0}``, patterns of operations
    suffix : of numbers
    infix : signs of sum, difference, product and quotient
    """

    declare: str = ""
    assign: str = "="
    end: str = ""
    functions: Mapping[str, str] = field(default_factory=dict)
    suffix: str = ""
    infix: Mapping[str, str] = field(default_factory=lambda: _INFIX)

    def number(self, value: float) -> str:
        """Write a number with all of its digits."""
        text = repr(float(value))
        if text in ("nan", "inf", "-inf"):
            raise ValueError("a model's numbers are finite")
        digits, exponent, power = text.partition("e")
        text = digits + ("" if "." in digits else ".0") + exponent + power
        return f"{text}{self.suffix}" if value >= 0 else f"({text}{self.suffix})"


#: Words of Python with numpy's functions.
PYTHON = Dialect(
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


def statements(
    outputs: Mapping[str, Node], dialect: Dialect, variables: Mapping[str, str], indent: str = "    "
) -> tuple[list[str], dict[str, str]]:
    """Write lines that compute some outputs, and each one's expression; ``variables`` has the words for them."""
    nodes = needed(outputs.values())
    counts = uses(nodes, list(outputs.values()))
    words: dict[int, tuple[str, int]] = {}
    lines = list[str]()
    for node in nodes:
        text, depth = _word(node, words, dialect, variables)
        if node.operation not in ("number", "variable") and (counts[node.number] > 1 or depth >= _DEEPEST):
            name = f"u{len(lines)}"
            lines.append(f"{indent}{dialect.declare}{name} {dialect.assign} {text}{dialect.end}")
            text, depth = name, 0
        words[node.number] = text, depth
    return lines, {name: words[node.number][0] for name, node in outputs.items()}


def _word(
    node: Node, words: Mapping[int, tuple[str, int]], dialect: Dialect, variables: Mapping[str, str]
) -> tuple[str, int]:
    """Write a node as text, and return how deep it is nested."""
    if node.operation == "number":
        return dialect.number(float(node)), 0
    if node.operation == "variable":
        return variables[str(node.value)], 0
    arguments = [words[argument.number][0] for argument in node.arguments]
    depth = 1 + max(words[argument.number][1] for argument in node.arguments)
    if node.operation in dialect.infix:
        return f"({arguments[0]} {dialect.infix[node.operation]} {arguments[1]})", depth
    if node.operation == "neg":
        return f"(-{arguments[0]})", depth
    if node.operation == "curve":
        return dialect.functions["curve"].format(arguments[0], node.value), depth
    if node.operation == "signed_power":
        return _signed_power(node, arguments[0], dialect), depth
    pattern = dialect.functions.get(node.operation, node.operation)
    return (pattern.format(*arguments) if "{" in pattern else f"{pattern}({', '.join(arguments)})"), depth


def _signed_power(node: Node, speed: str, dialect: Dialect) -> str:
    """Write a call with :func:`fitting.arm.expected.expected_power`'s constants."""
    noise, p = (float(argument) for argument in node.arguments[1:])
    factor = noise**p * 2 ** ((p + 1) / 2) * float(scipy.special.gamma(1 + p / 2)) / 3.141592653589793**0.5
    numbers = ", ".join(dialect.number(value) for value in (noise, p, factor))
    power = dialect.functions["signed_power"]
    return f"{dialect.functions.get('signed_root', power) if p == 1 / 3 else power}({speed}, {numbers})"
