"""The model as one function file of MATLAB and GNU Octave, without toolboxes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from daq.errors import InputError
from daq.recordings.recording_files import replacing
from fitting.model.arm_model import ArmModel
from fitting.model.export.c import Function, functions_of, identifier
from fitting.model.export.printing import Dialect, curves_of, statements
from fitting.model.export.tracing.graph import Curve, needed
from fitting.model.export.tracing.tracing import Tracer
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

_HELPERS = """
function y = signed_power(v, noise, p, factor)
% Expectation of |v|^p sgn v of a speed v that was measured with normal noise: near zero by Kummer's function, a sum of
% positive terms; beyond six noise widths by its asymptotic series.
    y = abs(v) .^ p .* sign(v);
    if noise <= 0
        return
    end
    u = v / noise;
    near = abs(u) < 6;
    w = u(~near) .^ -2;
    y(~near) = y(~near) .* (1 + p * (p - 1) / 2 * w .* (1 + (p - 2) * (p - 3) / 4 * w));
    u = u(near);
    z = u .^ 2 / 2;
    term = ones(size(z));
    total = term;
    for k = 0:199
        term = term .* ((1 + p / 2 + k) / (1.5 + k) / (k + 1)) .* z;
        total = total + term;
        if all(term <= 1e-17 * total)
            break
        end
    end
    y(near) = factor * u .* exp(-z) .* total;
end

function y = piecewise(x, table)
% Piecewise cubic, constant beyond its ends.
    [breaks, pieces] = table();
    x = min(max(x, breaks(1)), breaks(end));
    y = zeros(size(x));
    for i = 1:numel(x)
        k = max(1, find(x(i) >= breaks(1:end-1), 1, 'last'));
        d = x(i) - breaks(k);
        y(i) = ((pieces(k, 1) * d + pieces(k, 2)) * d + pieces(k, 3)) * d + pieces(k, 4);
    end
end
"""


def write_matlab(model: ArmModel, path: Path) -> Written:
    """Write the model as ``NAME.m``, the file's name being the function's.

    Raises
    ------
    InputError
        If the file's name is none that a function can have.
    """
    if path.suffix != ".m" or identifier(path.stem) != path.stem.lower():
        raise InputError(f"{path}: name the file after its function, as in {identifier(model.machine.name)}.m")
    tracer = Tracer(model)
    with replacing(path) as temporary:
        temporary.write_text(matlab_source(tracer, path.stem), encoding="utf-8")
    return Written((path,), tuple(tracer.left_out))


def matlab_source(tracer: Tracer, name: str) -> str:
    """Text of the file."""
    functions = functions_of(tracer)
    used = curves_of(needed([node for own in functions for node in own.nodes]))
    parts = [_main(tracer, name, functions)]
    parts += [_function(own, len(tracer.model.joints)) for own in functions]
    parts += [_HELPERS.strip("\n"), *(_table(number, tracer.graph.curves[number]) for number in used)]
    return "\n\n".join(parts) + "\n"


def _main(tracer: Tracer, name: str, functions: Sequence[Function]) -> str:
    """The function that is called: what it is asked comes first."""
    joints = len(tracer.model.joints)
    said = [f"{name.upper()}  {heading(tracer)[0]}", *heading(tracer)[1:], ""]
    for own in functions:
        said.append(f"[{', '.join(own.outputs)}] = {name}('{own.name}', {', '.join(_arguments(own))})")
    said.append(f"Motions are N x {joints}, a row per sample; t is N x 1 or one number, 0 if it is left out.")
    cases = [
        line
        for own in functions
        for line in (f"        case '{own.name}'", f"            [varargout{{:}}] = {own.name}(varargin{{:}});")
    ]
    return "\n".join(
        [
            f"function varargout = {name}(what, varargin)",
            *(f"% {line}".rstrip() for line in said),
            "    varargout = cell(1, max(nargout, 1));",
            "    switch what",
            *cases,
            "        otherwise",
            f"            error('{name}: there is no %s', what);",
            "    end",
            "end",
        ]
    )


def _arguments(own: Function) -> list[str]:
    words = {"q": "q", "v": "qd", "a": "qdd"}
    return [*(words[letter] for letter in own.letters), *(["t"] if own.timed else [])]


def _function(own: Function, joints: int) -> str:
    arguments = _arguments(own)
    named = {
        f"{letter}{j}": f"{word}(:, {j + 1})"
        for letter, word in zip(own.letters, arguments, strict=False)
        for j in range(joints)
    } | {"t": "t"}
    targets = {f"{output}{j}": node for output, nodes in own.outputs.items() for j, node in enumerate(nodes)}
    lines, words = statements(targets, DIALECT, named)
    results = []
    for output in own.outputs:
        columns = ", ".join(f"{words[output + str(j)]} + still" for j in range(joints))
        results.append(f"    {output} = [{columns}];")
    clock = [f"    if nargin < {len(arguments)}", "        t = 0;", "    end", "    t = t(:);"] if own.timed else []
    head = f"function [{', '.join(own.outputs)}] = {own.name}({', '.join(arguments)})"
    return "\n".join([head, *clock, "    still = zeros(size(q, 1), 1);", *lines, *results, "end"])


def _table(number: int, curve: Curve) -> str:
    def row(values: Sequence[float]) -> str:
        return " ".join(DIALECT.number(value) for value in values)

    pieces = "; ...\n        ".join(row(own) for own in curve.pieces.tolist())
    breaks = row(curve.breaks.tolist())
    return (
        f"function [breaks, pieces] = curve_{number}()\n    breaks = [{breaks}];\n    pieces = [ ...\n"
        f"        {pieces}];\nend"
    )
