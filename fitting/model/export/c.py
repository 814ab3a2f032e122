"""The model in C99: no allocation, no state of its own, no library but libm; doubles and floats.

A folder with ``<name>.h``, ``<name>.c`` and ``<name>_selftest.c``, which holds tables of states and of a motion and of
what the model says of them, and exits with 1 where the compiled code says otherwise. What a model with a history
remembers is an array of the caller's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daq.recordings.recording_files import replacing
from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import (
    ARRAYS,
    Function,
    expected,
    functions_of,
    identifier,
    rendered,
    states,
    swing,
)
from fitting.model.export.printing import Dialect, curves_of
from fitting.model.export.tracing.graph import Node, needed
from fitting.model.export.tracing.tracing import Tracer, tracer_of
from fitting.model.export.words import Written, heading, require_folder

#: States of the self-test, and the largest difference that passes, as a share of the largest effort.
_STATES = 24
TOLERANCE = {"double": 1e-9, "float": 2e-4}
_KINDS = (("double", ""), ("float", "f"))


def write_c(model: ArmModel, path: Path) -> Written:
    """Write the model as C source in a folder.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(path)
    tracer = tracer_of(model)
    name = identifier(model.machine.name)
    functions = functions_of(tracer)
    files = c_files(tracer, functions) | {f"{name}_selftest.c": _selftest(tracer, functions)}
    for name, text in files.items():
        with replacing(path / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return Written(tuple(path / name for name in files), tuple(tracer.left_out))


def c_files(tracer: Tracer, functions: Sequence[Function]) -> dict[str, str]:
    """Header and source by name."""
    name = identifier(tracer.model.machine.name)
    nodes = needed([node for own in functions for node in own.nodes])
    words = {
        "name": name,
        "upper": name.upper(),
        "joints": len(tracer.model.joints),
        "memory": len(tracer.memory),
        "said": [line.replace("*/", "* /") for line in _said(tracer, name)],
        "signatures": [_signature(name, tracer, own, *kind) for own in functions for kind in _KINDS],
        "used": _used(nodes),
        "curves": [
            {"number": k, "breaks": tracer.graph.curves[k].breaks, "pieces": tracer.graph.curves[k].pieces}
            for k in curves_of(nodes)
        ],
        "functions": {s: [_function(name, tracer, own, kind, s) for own in functions] for kind, s in _KINDS},
    }
    return {f"{name}.{end}": rendered(f"arm.{end}.j2", **words) for end in "hc"}


def _said(tracer: Tracer, name: str) -> list[str]:
    remembers = (
        f"init sets memory[{len(tracer.memory)}] at a motion's first moment, step at each later one, dt seconds after "
        "the one before; in the other functions what has a history is settled."
    )
    return [
        *heading(tracer),
        "",
        "Functions without suffix take doubles, those with suffix f floats. Arrays have a value per joint.",
        "inverse_dynamics: joint efforts; drive_efforts: N at a piston; gravity: joint efforts at rest; friction: what",
        "turns with the speed's sign; pressures: those of the head, and of the rod as the recordings show it;",
        "beyond: 1 of a joint beyond the positions and speeds that were recorded, where no error is known.",
        *([remembers] if tracer.memory else []),
        f"Self-test: cc -std=c99 -O2 {name}.c {name}_selftest.c -lm && ./a.out",
    ]


def _signature(name: str, tracer: Tracer, own: Function, kind: str, suffix: str) -> str:
    sizes = dict.fromkeys(("q", "qd", "qdd"), len(tracer.model.joints)) | {"memory": len(tracer.memory)}
    joints = len(tracer.model.joints)
    words = [
        f"{'' if word in own.outputs else 'const '}{kind} {word}[{sizes[word]}]" if word in ARRAYS else f"{kind} {word}"
        for word in own.arguments
    ]
    words += [f"{kind} {word}[{sizes.get(word, joints)}]" for word in own.outputs if word not in own.arguments]
    return f"void {name}_{own.name}{suffix}({', '.join(words)})"


def _dialect(name: str, kind: str, suffix: str) -> Dialect:
    own = {word: f"{name}_{word}{suffix}" for word in ("sign", "above", "at_least")}
    maths = {w: f"{w}{suffix}" for w in ("sin", "cos", "exp", "expm1", "tanh", "sqrt", "erf", "hypot")}
    return Dialect(
        declare=f"const {kind} ",
        end=";",
        functions={
            **own,
            **maths,
            "abs": f"fabs{suffix}",
            "max": f"fmax{suffix}",
            "min": f"fmin{suffix}",
            "power": f"pow{suffix}",
            "signed_power": f"{name}_power{suffix}",
            "signed_root": f"{name}_root{suffix}",
            "curve": f"{name}_curve{suffix}({{0}}, {name}_breaks_{{1}}{suffix}, {name}_pieces_{{1}}{suffix}, "
            f"{name.upper()}_PIECES_{{1}})",
        },
        suffix=suffix,
    )


def _used(nodes: Sequence[Node]) -> set[str]:
    """Helpers that some nodes ask for."""
    roots = {float(node.arguments[2]) == 1 / 3 for node in nodes if node.operation == "signed_power"}
    return {node.operation for node in nodes} | {"root" if root else "any_power" for root in roots}


def _function(name: str, tracer: Tracer, own: Function, kind: str, suffix: str) -> dict[str, object]:
    """Signature and body of a function."""

    # What is kept is written where it was read: it is read first.
    def word(array: str, k: int) -> str:
        return f"kept_{k}" if array == "memory" else f"{array}[{k}]"

    lines, results = own.body(_dialect(name, kind, suffix), word)
    named = own.variables(word)
    body = [f"const {kind} {named[letter]} = memory[{letter[1:]}];" for letter in named if letter[0] == "m"]
    asked = {variable if variable in ("t", "dt") else variable[0] for variable in named} | {"m"}
    body += [*lines, *(f"(void){given};" for given in own.arguments if ARRAYS.get(given, given) not in asked)]
    body += [f"{output}[{k}] = {found};" for output, words in results.items() for k, found in enumerate(words)]
    return {"signature": _signature(name, tracer, own, kind, suffix), "body": body}


def _selftest(tracer: Tracer, functions: Sequence[Function]) -> str:
    table, moved = states(tracer.model, _STATES), swing(tracer.model, _STATES)
    still, walked = expected(tracer, table, settled=True), expected(tracer, moved)
    return rendered(
        "selftest.c.j2",
        name=identifier(tracer.model.machine.name),
        joints=len(tracer.model.joints),
        memory=len(tracer.memory),
        more=[k * len(tracer.model.joints) for k in range(len(functions[-1].outputs) - 2)],  # beside tau and memory
        table=np.column_stack([*table, still]),
        moved=np.column_stack([*moved, walked]),
        dt=repr(1.0 / tracer.model.machine.rate_hz),
        largest=repr(float(np.max(np.abs(np.vstack([still, walked])))) or 1.0),
        tolerance=TOLERANCE,
    )
