"""The model as one function file of MATLAB and GNU Octave, without toolboxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.errors import InputError
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import Function, Program, heading, identifier, program_of, rendered, written
from fitting.model.export.printing import Dialect
from fitting.model.export.words import Written

DIALECT = Dialect(
    end=";",
    functions={
        "above": "double({0} > {1})",
        "at_least": "double({0} >= {1})",
        "power": "({0} .^ {1})",
        "signed_power": "signed_power",
        "curve": "piecewise({0}, @curve_{1})",
    },
    infix={"add": "+", "sub": "-", "mul": ".*", "div": "./"},
)


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write the model as ``NAME.m``, the file's name being the function's.

    Raises
    ------
    InputError
        If the file's name is none that a function can have.
    """
    if path.suffix != ".m" or identifier(path.stem) != path.stem.lower():
        raise InputError("fitting.export_matlab_name", path=path, function=identifier(model.machine.name))
    program = program_of(model)
    return written(path.parent, {path.name: _source(program, path.stem)}, program.tracer.left_out)


def _source(program: Program, name: str) -> str:
    """Write the text of the file."""
    functions, joints = program.functions, program.joints
    calls = [f"[{', '.join(own.outputs)}] = {name}('{own.name}', {', '.join(own.arguments)})" for own in functions]
    rows = f"Motions are N x {joints}, a row per sample, memory has one; t is N x 1 or one number, 0 if it is left out."
    first, *others = heading(program.tracer)
    return rendered(
        "arm.m.j2",
        name=name,
        card=[f"{name.upper()}  {first}", *others, "", *calls, rows],
        functions=[_function(own) for own in functions],
        curves=program.curves,
    )


def _function(own: Function) -> dict[str, Any]:
    lines, words = own.body(DIALECT, lambda name, place: name if place is None else f"{name}(:, {place + 1})")
    results = [f"{output} = [{', '.join(f'{word} + still' for word in found)}];" for output, found in words.items()]
    clock = [f"{word} = {word}(:);" for word in ("t", "temperature") if word in own.arguments]
    if own.arguments[-1:] == ("t",):
        clock = [f"if nargin < {len(own.arguments)}", "    t = 0;", "end", *clock]
    body = [*clock, "still = zeros(size(q, 1), 1);", *lines, *results]
    return {"name": own.name, "arguments": own.arguments, "outputs": list(own.outputs), "body": body}
