"""Functions of an exported program, as nodes: the same ones in every language."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from daq.errors import InputError
from daq.whole_files import replacing
from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.printing import Dialect, statements
from fitting.model.export.tracing.graph import Node, needed
from fitting.model.export.tracing.moments import State
from fitting.model.export.tracing.tracing import Past, Tracer, tracer_of
from fitting.model.export.words import Written, model_card

#: Letter of the variables of each array that a function takes; other arguments are single numbers.
ARRAYS = {"q": "q", "qd": "v", "qdd": "a", "memory": "m", "head": "h", "rod": "p"}
_LETTERS = {letter: name for name, letter in ARRAYS.items()}
#: Arguments that are single numbers, and variables of the graph.
NUMBERS = ("t", "dt", "temperature")
_KEYWORDS = {"int", "float", "double", "long", "short", "char", "void", "for", "do", "if", "else", "while", "main"}

#: What is written for an entry of an array; ``None`` asks for the word of a single number.
Word = Callable[[str, int | None], str]


def indexed(name: str, place: int | None) -> str:
    """Write an index as most languages do."""
    return name if place is None else f"{name}[{place}]"


@dataclass(frozen=True)
class Function:
    """A function of an exported program.

    Attributes
    ----------
    name : its name
    arguments : what it takes: ``q``, ``qd``, ``qdd`` (a number per joint), ``t``, ``dt`` (s), ``temperature`` (K),
        ``memory``
    outputs : nodes by name; ``memory`` is what is kept for the next call
    """

    name: str
    arguments: tuple[str, ...]
    outputs: dict[str, tuple[Node, ...]]

    @property
    def nodes(self) -> list[Node]:
        """All outputs in a row."""
        return [node for own in self.outputs.values() for node in own]

    def variables(self, word: Word) -> dict[str, str]:
        """Return the word for each variable of its nodes."""
        asked = [str(node.value) for node in needed(self.nodes) if node.operation == "variable"]
        return {own: word(own, None) if own in NUMBERS else word(_LETTERS[own[0]], int(own[1:])) for own in asked}

    def body(self, dialect: Dialect, word: Word) -> tuple[list[str], dict[str, list[str]]]:
        """Write a language's statements, and by output the expression of each number; see :meth:`variables`."""
        targets = {f"{output}{k}": node for output, nodes in self.outputs.items() for k, node in enumerate(nodes)}
        lines, words = statements(targets, dialect, self.variables(word), "")
        return lines, {output: [words[f"{output}{k}"] for k in range(len(own))] for output, own in self.outputs.items()}

    def assignments(self, dialect: Dialect, word: Word = indexed) -> list[str]:
        """Write statements that set every output number by number: what is kept is read before it is set."""

        def kept(name: str, place: int | None) -> str:
            return f"kept_{place}" if name == "memory" else word(name, place)

        lines, results = self.body(dialect, kept)
        reads = [(kept("memory", int(v[1:])), word("memory", int(v[1:]))) for v in self.variables(kept) if v[0] == "m"]
        sets = [(word(output, k), found) for output, words in results.items() for k, found in enumerate(words)]
        first = [f"{dialect.declare}{name} {dialect.assign} {found}{dialect.end}" for name, found in reads]
        return [*first, *lines, *(f"{name} {dialect.assign} {found}{dialect.end}" for name, found in sets)]


@dataclass(frozen=True)
class Program:
    """Functions of a model, to be printed in a language; ``name`` is the machine's, as languages take it."""

    name: str
    tracer: Tracer
    functions: tuple[Function, ...]

    @property
    def joints(self) -> int:
        """Number of the machine's joints."""
        return len(self.tracer.model.joints)

    @property
    def memory(self) -> int:
        """Count of numbers kept from moment to moment."""
        return len(self.tracer.memory) if any("memory" in own.outputs for own in self.functions) else 0

    @cached_property
    def nodes(self) -> list[Node]:
        """All that the functions are made of, arguments first."""
        return needed([node for own in self.functions for node in own.nodes])

    @property
    def used(self) -> set[str]:
        """Helpers that they ask for: operations, and ``root`` or ``any_power`` for signed powers."""
        roots = {float(node.arguments[2]) == 1 / 3 for node in self.nodes if node.operation == "signed_power"}
        return {node.operation for node in self.nodes} | {"root" if root else "any_power" for root in roots}

    @property
    def curves(self) -> list[dict[str, Any]]:
        """Piecewise cubics that they ask for: ``number``, ``breaks`` and ``pieces``."""
        used = sorted({int(str(node.value)) for node in self.nodes if node.operation == "curve"})
        return [{"number": k, **vars(self.tracer.graph.curves[k])} for k in used]

    def sizes(self, own: Function) -> dict[str, int]:
        """Return the lengths of a function's arrays by name: of an output, or a value per joint."""
        return dict.fromkeys(ARRAYS, self.joints) | {word: len(nodes) for word, nodes in own.outputs.items()}


def program_of(model: ArmModel) -> Program:
    """Return the functions of a model, or of the fit without what no format has.

    Raises
    ------
    InputError
        If the machine has something that no format has.
    """
    tracer = tracer_of(model)
    return Program(identifier(model.machine.name), tracer, tuple(_functions_of(tracer)))


def forward_program(model: ArmModel, possible: bool) -> tuple[Program | None, tuple[str, ...]]:
    """Return the program of motion under efforts (:func:`fitting.model.simulation.simulate`); lines on it.

    Of a model without what no format has. None where the mass matrix has no inverse somewhere, and the nearest model
    that has one is not asked for.
    """
    try:
        model, notes = moving_model(model, possible)
    except InputError as error:
        return None, (f"forward dynamics: {str(error).removeprefix('export: ')}",)
    tracer = Tracer(motion.integrable(model))
    state = tracer.variables()
    head, rod = ([tracer.graph.variable(f"{ARRAYS[word]}{k}") for k in range(len(state.q))] for word in ("head", "rod"))
    pressed = Function("pressed", ("q", "head", "rod"), {"tau": tracer.pressed(state, head, rod)})
    name = f"{identifier(model.machine.name)}_forward"
    settled = ("what remembers is settled in it",) if tracer.memory else ()
    lines = tuple(f"forward dynamics: {line}" for line in (*notes, *settled))
    return Program(name, tracer, (*moving_functions(tracer), pressed)), lines


def moving_model(model: ArmModel, possible: bool) -> tuple[ArmModel, tuple[str, ...]]:
    """Return the model, or if asked the nearest that can move, and its cost; refuse where none can."""
    wrong = motion.indefinite(model)
    if wrong is None:
        return model, ()
    if not possible:
        raise InputError("fitting.export_not_moving", reason=wrong.text)
    own = motion.nearest_possible(model)
    price = motion.price(model, own)
    cost = "" if price is None else f"; the error on another motion is {100 * price:+.1f} % of the model's own"
    return own, (f"the drives' inertias as they were found: none is below zero here{cost}",)


def heading(tracer: Tracer, *, remembers: bool = True) -> list[str]:
    """Write an exported program's first lines; ``remembers`` where it has the model's memory."""
    lines = [
        *model_card(tracer.model, tracer.left_out),
        "Signs of speeds are smooth: their expectation under the noise of the measured speed.",
        "t: seconds since the motion began.",
    ]
    if tracer.memory and remembers:
        lines.append(
            f"init sets {len(tracer.memory)} numbers of memory at a motion's first moment, step at each later one, "
            "seconds (dt) after the one before; otherwise what has a history is settled."
        )
    return lines


def written(folder: Path, texts: Mapping[str, str], left_out: Sequence[str]) -> Written:
    """Write files by name, each whole or not at all."""
    for name, text in texts.items():
        with replacing(folder / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return Written(tuple(folder / name for name in texts), tuple(left_out))


def _functions_of(tracer: Tracer) -> list[Function]:
    """List what an exported model can be asked."""
    state, moment = tracer.variables(), ("q", "qd", "qdd", "t", *tracer.oil)
    known = () if tracer.model.temperature is None else ("temperature",)
    found = tracer.efforts(state)
    result = [
        Function("inverse_dynamics", moment, {"tau": found["tau"]}),
        Function("drive_efforts", moment, {"force": found["force"]}),
        Function("gravity", ("q", *tracer.oil), {"tau": tracer.gravity(state.q)}),
        Function("friction", ("q", "qd", "t", *tracer.oil), {"tau": tracer.friction(state)}),
        Function("beyond", ("q", "qd", *known), {"flag": tracer.beyond(state)}),
    ]
    if "head" in found:
        result.append(Function("pressures", moment, {"head": found["head"], "rod": found["rod"]}))
    pasts: tuple[tuple[str, Past, tuple[str, ...]], ...] = (
        ("init", "first", (*moment, "dt")),
        ("step", "later", (*moment, "dt", "memory")),
    )
    for name, past, arguments in pasts if tracer.memory else ():
        kept = tuple(own.start if past == "first" else own.after for own in tracer.memory)
        result.append(Function(name, arguments, tracer.efforts(state, past) | {"memory": kept}))
    return result


def moving_functions(tracer: Tracer) -> list[Function]:
    """Return the functions of a motion: a moment's efforts, and the mass matrix (n x n, symmetric) in a row."""
    state, n = tracer.variables(), len(tracer.model.joints)
    still = [0.0] * n
    rest, columns = tracer.efforts(State(state.q, still, still, state.t))["tau"], list[Node]()
    for joint in range(n):
        unit = [1.0 if k == joint else 0.0 for k in range(n)]
        pushed = tracer.efforts(State(state.q, still, unit, state.t))["tau"]
        columns += [a - b for a, b in zip(pushed, rest, strict=True)]
    return [
        Function("effort", ("q", "qd", "qdd", "t", *tracer.oil), {"tau": tracer.efforts(state)["tau"]}),
        Function("inertia", ("q", "t", *tracer.oil), {"matrix": tuple(columns)}),
    ]


def identifier(name: str) -> str:
    """Make a C name of a machine's."""
    word = re.sub(r"[^0-9a-z]+", "_", name.lower()).strip("_") or "arm"
    return f"arm_{word}" if word[0].isdigit() or word in _KEYWORDS else word


def rendered(template: str, **words: Any) -> str:
    """Render a file of this folder with words in their places."""
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
    """Draw states within the machine's limits, the same each call: ``q, qd, qdd`` (count, n), ``t`` (count,)."""
    rng = np.random.default_rng(0)
    limits = [joint.limits for joint in model.machine.joints]
    low, high = model.limits
    shape = (count, len(limits))
    q = rng.uniform(low, high, shape)
    qd = rng.uniform(-1, 1, shape) * np.array([own.velocity for own in limits])
    qdd = rng.uniform(-1, 1, shape) * np.array([own.acceleration for own in limits])
    qd[: count // 8] = 0.0
    return q, qd, qdd, rng.uniform(0.0, model.passes[-1].ranges[0].time[1], count)


def swing(model: ArmModel, count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Make a motion in even steps within limits, as :func:`states`: every joint to and fro, each at its time."""
    limits = [joint.limits for joint in model.machine.joints]
    low, high = model.limits
    t = np.arange(count) / model.machine.rate_hz
    half = 0.5 * (high - low)
    w = np.array([own.velocity for own in limits]) / half
    phase = t[:, None] * w + np.arange(len(low))
    return 0.5 * (low + high) + half * np.sin(phase), half * w * np.cos(phase), -half * w**2 * np.sin(phase), t


def expected(tracer: Tracer, moved: Sequence[FloatArray], *, settled: bool = False) -> FloatArray:
    """Compute joint efforts (N, n) that a program must give at ``q, qd, qdd, t``: moments alone, or in sequence.

    The oil is at its usual temperature.
    """
    carried = motion.at_rest(tracer.carried) if settled else tracer.carried
    return motion.on_motion(carried, *moved, temperature=carried.usual_oil).joint_effort(0)
