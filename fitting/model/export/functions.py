"""What an exported program can be asked, as nodes: the same functions in every language."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np

from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.printing import Dialect, statements
from fitting.model.export.tracing.graph import Node, needed
from fitting.model.export.tracing.moment import Efforts
from fitting.model.export.tracing.tracing import Past, Tracer

#: Letter of the variables of each array that a function takes; other arguments are single numbers.
ARRAYS = {"q": "q", "qd": "v", "qdd": "a", "memory": "m"}
_KEYWORDS = {"int", "float", "double", "long", "short", "char", "void", "for", "do", "if", "else", "while", "main"}


@dataclass(frozen=True)
class Function:
    """A function of an exported program.

    Attributes
    ----------
    name : its name
    arguments : what it takes: ``q``, ``qd``, ``qdd`` (a number per joint), ``t``, ``dt`` (s), ``memory``
    outputs : nodes by name; ``memory`` is what is kept for the next call
    """

    name: str
    arguments: tuple[str, ...]
    outputs: dict[str, tuple[Node, ...]]

    @property
    def nodes(self) -> list[Node]:
        """All outputs in a row."""
        return [node for own in self.outputs.values() for node in own]

    def variables(self, word: Callable[[str, int], str]) -> dict[str, str]:
        """What stands for each variable of its nodes; ``word`` gives that of an array's entry."""
        asked = [str(node.value) for node in needed(self.nodes) if node.operation == "variable"]
        arrays = {letter: name for name, letter in ARRAYS.items()}
        return {own: own if own in ("t", "dt") else word(arrays[own[0]], int(own[1:])) for own in asked}

    def body(self, dialect: Dialect, word: Callable[[str, int], str]) -> tuple[list[str], dict[str, list[str]]]:
        """Statements of a language, and by output the expression of each of its numbers; see :meth:`variables`."""
        targets = {f"{output}{k}": node for output, nodes in self.outputs.items() for k, node in enumerate(nodes)}
        lines, words = statements(targets, dialect, self.variables(word), "")
        return lines, {output: [words[f"{output}{k}"] for k in range(len(own))] for output, own in self.outputs.items()}


def functions_of(tracer: Tracer) -> list[Function]:
    """What an exported model can be asked."""
    state, moment = tracer.variables(), ("q", "qd", "qdd", "t")
    found = _said(tracer.efforts(state))
    result = [
        Function("inverse_dynamics", moment, {"tau": found["tau"]}),
        Function("drive_efforts", moment, {"force": found["force"]}),
        Function("gravity", ("q",), {"tau": tracer.gravity(state.q)}),
        Function("friction", ("q", "qd", "t"), {"tau": tracer.friction(state)}),
        Function("beyond", ("q", "qd"), {"flag": tracer.beyond(state)}),
    ]
    if "head" in found:
        result.append(Function("pressures", moment, {"head": found["head"], "rod": found["rod"]}))
    pasts: tuple[tuple[str, Past, tuple[str, ...]], ...] = (
        ("init", "first", (*moment, "dt")),
        ("step", "later", (*moment, "dt", "memory")),
    )
    for name, past, arguments in pasts if tracer.memory else ():
        kept = tuple(own.start if past == "first" else own.after for own in tracer.memory)
        result.append(Function(name, arguments, _said(tracer.efforts(state, past)) | {"memory": kept}))
    return result


def _said(found: Efforts) -> dict[str, tuple[Node, ...]]:
    """Efforts of joints and drives, and the pressures where all are known."""
    result = {"tau": found.joint, "force": found.drive}
    head, rod = (tuple(node for node in own if node is not None) for own in (found.head, found.rod))
    return result | ({"head": head, "rod": rod} if len(head) == len(rod) == len(found.joint) else {})


def identifier(name: str) -> str:
    """A name that C takes, of a machine's."""
    word = re.sub(r"[^0-9a-z]+", "_", name.lower()).strip("_") or "arm"
    return f"arm_{word}" if word[0].isdigit() or word in _KEYWORDS else word


def rendered(template: str, **words: Any) -> str:
    """A file of this folder with words in their places."""
    environment = jinja2.Environment(
        autoescape=template.endswith((".xml.j2", ".urdf.j2", ".mjcf.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
        finalize=lambda value: float(value) if isinstance(value, np.floating) else value,
    )
    environment.filters["numbers"] = lambda row, suffix="": ", ".join(map(Dialect(suffix=suffix).number, row))
    environment.filters["row"] = lambda row: " ".join(repr(float(value)) for value in row)
    text = files("fitting.model.export").joinpath("templates", template).read_text(encoding="utf-8")
    return environment.from_string(text).render(words)


def states(model: ArmModel, count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """States within the limits of the machine, the same at each call: ``q, qd, qdd`` (count, n) and ``t`` (count,)."""
    rng = np.random.default_rng(0)
    limits = [joint.limits for joint in model.machine.joints]
    low, high = np.array([own.position for own in limits]).T
    shape = (count, len(limits))
    q = rng.uniform(low, high, shape)
    qd = rng.uniform(-1, 1, shape) * np.array([own.velocity for own in limits])
    qdd = rng.uniform(-1, 1, shape) * np.array([own.acceleration for own in limits])
    qd[: count // 8] = 0.0
    return q, qd, qdd, rng.uniform(0.0, model.passes[-1].ranges[0].time[1], count)


def swing(model: ArmModel, count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """A motion in even steps within the limits, as :func:`states` has it: every joint to and fro, each at its time."""
    limits = [joint.limits for joint in model.machine.joints]
    low, high = np.array([own.position for own in limits]).T
    t = np.arange(count) / model.machine.rate_hz
    half = 0.5 * (high - low)
    w = np.array([own.velocity for own in limits]) / half
    phase = t[:, None] * w + np.arange(len(low))
    return 0.5 * (low + high) + half * np.sin(phase), half * w * np.cos(phase), -half * w**2 * np.sin(phase), t


def expected(tracer: Tracer, moved: Sequence[FloatArray], *, settled: bool = False) -> FloatArray:
    """Joint efforts (N, n) that a program has to say of ``q, qd, qdd, t``: of moments alone, or one after the other."""
    carried = motion.at_rest(tracer.carried) if settled else tracer.carried
    return motion.on_motion(carried, *moved).joint_effort(0)
