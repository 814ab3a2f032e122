"""The model as one function file of MATLAB and GNU Octave, without toolboxes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from daq.errors import InputError
from daq.recordings.recording_files import replacing
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import Function, functions_of, identifier, rendered
from fitting.model.export.printing import Dialect, curves_of
from fitting.model.export.tracing.graph import needed
from fitting.model.export.tracing.tracing import Tracer, tracer_of
from fitting.model.export.words import Written, heading

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


def write_matlab(model: ArmModel, path: Path) -> Written:
    """Write the model as ``NAME.m``, the file's name being the function's.

    Raises
    ------
    InputError
        If the file's name is none that a function can have.
    """
    if path.suffix != ".m" or identifier(path.stem) != path.stem.lower():
        raise InputError(f"{path}: name the file after its function, as in {identifier(model.machine.name)}.m")
    tracer = tracer_of(model)
    with replacing(path) as temporary:
        temporary.write_text(matlab_source(tracer, path.stem), encoding="utf-8")
    return Written((path,), tuple(tracer.left_out))


def matlab_source(tracer: Tracer, name: str) -> str:
    """Text of the file."""
    functions, joints = functions_of(tracer), len(tracer.model.joints)
    used = curves_of(needed([node for own in functions for node in own.nodes]))
    calls = [f"[{', '.join(own.outputs)}] = {name}('{own.name}', {', '.join(own.arguments)})" for own in functions]
    rows = f"Motions are N x {joints}, a row per sample; t is N x 1 or one number, 0 if it is left out."
    remembers = (
        f"init is of a motion's first moment, step of each later one, dt seconds after the one before; memory is N x "
        f"{len(tracer.memory)}, a row per motion. In the other functions what has a history is settled."
    )
    return rendered(
        "arm.m.j2",
        name=name,
        said=[f"{name.upper()}  {heading(tracer)[0]}", *heading(tracer)[1:], "", *calls, rows]
        + ([remembers] if tracer.memory else []),
        functions=[_function(own) for own in functions],
        curves=[
            {"number": k, "breaks": tracer.graph.curves[k].breaks, "pieces": tracer.graph.curves[k].pieces}
            for k in used
        ],
    )


def _function(own: Function) -> dict[str, Any]:
    lines, words = own.body(DIALECT, lambda array, k: f"{array}(:, {k + 1})")
    results = [f"{output} = [{', '.join(f'{word} + still' for word in found)}];" for output, found in words.items()]
    clock = ["t = t(:);"] if "t" in own.arguments else []
    if own.arguments[-1:] == ("t",):
        clock = [f"if nargin < {len(own.arguments)}", "    t = 0;", "end", *clock]
    body = [*clock, "still = zeros(size(q, 1), 1);", *lines, *results]
    return {"name": own.name, "arguments": own.arguments, "outputs": list(own.outputs), "body": body}
