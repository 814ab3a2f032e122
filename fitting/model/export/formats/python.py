"""The model as one Python file that needs numpy only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import ARRAYS, Function, Program, heading, program_of, rendered, written
from fitting.model.export.printing import PYTHON
from fitting.model.export.words import Written


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write the model as a Python module."""
    program = program_of(model)
    return written(path.parent, {path.name: _source(program)}, program.tracer.left_out)


def _source(program: Program) -> str:
    """Write the module: a function has one value, but for what is kept beside it."""
    functions = list[Function]()
    for own in program.functions:
        apart = own.name == "pressures"
        functions += (
            [Function(f"{k}_pressures", own.arguments, {k: v}) for k, v in own.outputs.items()] if apart else [own]
        )
    return rendered(
        "arm.py.j2",
        card=heading(program.tracer),
        joints=list(program.tracer.model.joints),
        curves=[{key: own if key == "number" else own.tolist() for key, own in c.items()} for c in program.curves],
        functions=[_function(own) for own in functions],
    )


def _function(own: Function) -> dict[str, Any]:
    """Write a function on arrays (N, n)."""

    def word(name: str, place: int | None) -> str:
        return name if place is None else f"{ARRAYS[name]}{place}"

    given = [name for name in own.arguments if name in ARRAYS]
    lines, words = own.body(PYTHON, word)
    asked = own.variables(word)
    first = [f"{name} = np.asarray({name}, dtype=float)" for name in given]
    first += [
        f"{v} = {name}[..., {v[1:]}]" for name in given for v in asked if v[0] == ARRAYS[name] and v[1:].isdigit()
    ]
    late = own.arguments[-1] == "t"  # what is one of several moments has a time
    arguments = ", ".join("t=0.0" if name == "t" and late else name for name in own.arguments)
    results = [f"np.stack([{', '.join(f'{word} + still' for word in own)}], axis=-1)" for own in words.values()]
    body = [*first, "still = np.zeros(q.shape[:-1])", *lines]
    return {"name": own.name, "arguments": arguments, "body": body, "results": results}
