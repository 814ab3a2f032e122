"""The model as Structured Text of IEC 61131-3: function blocks for a controller, without a library.

A block for each function, ``NAME_inverse_dynamics`` and so on: arrays of LREAL in, arrays out. What a model with a
history remembers is an array of the caller's, which ``NAME_init`` and ``NAME_step`` get as VAR_IN_OUT. Only standard
functions of the second edition (2003) are called, and types are never mixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import Function, Program, heading, indexed, program_of, rendered, written
from fitting.model.export.printing import Dialect
from fitting.model.export.words import Written

#: DT is the language's own word for a date and time.
_WORDS = {"t": "t_s", "dt": "dt_s"}
_ACROSS = 12


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write the model as one text file of functions and function blocks."""
    program = program_of(model)
    return written(path.parent, {path.name: _source(program)}, program.tracer.left_out)


def _source(program: Program) -> str:
    lines = [
        *heading(program.tracer),
        "",
        "A function block for each question; arrays have a value per joint; t and dt are called t_s and dt_s.",
    ]
    return rendered(
        "arm.st.j2",
        name=program.name,
        card=[line.replace("*)", "* )").replace("(*", "( *") for line in lines],
        used=program.used,
        curves=program.curves,
        blocks=[_block(program, own) for own in program.functions],
    )


def _block(program: Program, own: Function) -> dict[str, object]:
    """Write name, declarations and body of a function block."""
    body = own.assignments(dialect_of(program.name), lambda name, place: indexed(_WORDS.get(name, name), place))
    local = [name for name, _, _ in (line.partition(" :=") for line in body) if "[" not in name]
    sizes = program.sizes(own)

    def declared(names: Sequence[str]) -> list[str]:
        return [f"{_WORDS.get(n, n)} : {f'ARRAY[0..{sizes[n] - 1}] OF ' if n in sizes else ''}LREAL;" for n in names]

    sections = {
        "VAR_INPUT": declared([name for name in own.arguments if name != "memory"]),
        "VAR_IN_OUT": declared(["memory"] if "memory" in own.outputs else []),
        "VAR_OUTPUT": declared([name for name in own.outputs if name != "memory"]),
        "VAR": [f"{', '.join(local[k : k + _ACROSS])} : LREAL;" for k in range(0, len(local), _ACROSS)],
    }
    return {"name": own.name, "sections": sections, "body": body}


def dialect_of(name: str) -> Dialect:
    own = {word: f"{name}_{word}" for word in ("sign", "tanh", "expm1", "erf", "hypot")}
    standard = {word: word.upper() for word in ("sin", "cos", "exp", "sqrt", "abs", "max", "min")}
    more = {
        "above": "SEL({0} > {1}, 0.0, 1.0)",
        "at_least": "SEL({0} >= {1}, 0.0, 1.0)",
        "power": "EXPT",
        "signed_power": f"{name}_power",
        "curve": f"{name}_curve_{{1}}({{0}})",
    }
    return Dialect(assign=":=", end=";", functions={**own, **standard, **more})
