"""The model in C99: no allocation, no state of its own, no library but libm; doubles and floats.

A folder with ``<name>.h``, ``<name>.c`` and ``<name>_selftest.c``, which holds tables of states and of a motion and of
what the model states of them, and exits with 1 where the compiled code states otherwise. What a model with a history
remembers is an array of the caller's.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting.model.arm_model import ArmModel
from fitting.model.export.functions import (
    ARRAYS,
    Function,
    Program,
    expected,
    forward_program,
    heading,
    program_of,
    rendered,
    states,
    swing,
    written,
)
from fitting.model.export.printing import Dialect
from fitting.model.export.words import Written, require_folder

#: States of the self-test, and the largest difference that passes, as a share of the largest effort.
_STATES = 24
TOLERANCE = {"double": 1e-9, "float": 2e-4}
_KINDS = (("double", ""), ("float", "f"))


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write the model as C source in a folder.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(path)
    program = program_of(model)
    forward, lines = forward_program(program.tracer.model, possible)
    files = c_files(program) | {f"{program.name}_selftest.c": _selftest(program)}
    files |= {} if forward is None else forward_files(forward)
    return written(path, files, (*program.tracer.left_out, *lines))


def c_files(program: Program) -> dict[str, str]:
    """Write header and source by name."""
    return _files(program, _KINDS, _card(program), ())


def forward_files(program: Program) -> dict[str, str]:
    """Write header and source of :func:`~fitting.model.export.functions.forward_program`, an integrator."""
    name, n = program.name, program.joints
    size, oil = 2 * n + 1, "".join(f", double {word}" for word in program.tracer.oil)
    signatures = [
        f"void {name}_init(const double q[{n}], const double qd[{n}], double state[{size}])",
        f"int {name}_step(double state[{size}], const double effort[{n}], double t{oil}, double dt)",
        f"int {name}_acceleration({', '.join(f'const double {w}[{n}]' for w in ('q', 'qd', 'effort'))}, double t{oil}, "
        f"double qdd[{n}])",
    ]
    card = [
        *heading(program.tracer, remembers=False),
        "",
        f"Motion from joint efforts. state[{size}]: positions, speeds, and the length of the integrator's last step.",
        "init: a state. step: the state dt seconds after t, while efforts are held; errors of its own steps are kept",
        "below 1e-6 of a position or speed (Rosenbrock's formulas of Shampine and Reichelt, SIAM J. Sci. Comput. 18,",
        "1997). acceleration: of a moment under efforts. Both give 0, or why there is none: 1 the mass matrix is not",
        "positive definite there, 2 accelerations do not settle, 3 steps become too short; step leaves the state where",
        "it came to. pressed: joint efforts of chamber pressures. effort, inertia: what the motion follows from, with",
        "the memory of effects settled and signs of speed over a width that can be integrated.",
    ]
    files = _files(program, _KINDS[:1], card, signatures)
    files[f"{name}.c"] += rendered("forward.c.j2", name=name, joints=n, signatures=signatures, oil=program.tracer.oil)
    return files


def _files(
    program: Program, kinds: Sequence[tuple[str, str]], card: Sequence[str], more: Sequence[str]
) -> dict[str, str]:
    words = {
        "name": program.name,
        "upper": program.name.upper(),
        "joints": program.joints,
        "memory": program.memory,
        "card": [line.replace("*/", "* /") for line in card],
        "kinds": kinds,
        "signatures": [*more, *(_signature(program, own, *kind) for own in program.functions for kind in kinds)],
        "used": program.used,
        "curves": program.curves,
        "functions": {s: [_function(program, own, kind, s) for own in program.functions] for kind, s in kinds},
    }
    return {f"{program.name}.{end}": rendered(f"arm.{end}.j2", **words) for end in "hc"}


def _card(program: Program) -> list[str]:
    return [
        *heading(program.tracer),
        "",
        "Functions without suffix take doubles, those with suffix f floats. Arrays have a value per joint.",
        "inverse_dynamics: joint efforts; drive_efforts: N at a piston; gravity: joint efforts at rest; friction: what",
        "turns with the speed's sign; pressures: those of the head, and of the rod as the recordings show it;",
        "beyond: 1 of a joint beyond the positions, speeds and temperatures (K) that were recorded, where no error is",
        "known.",
        f"Self-test: cc -std=c99 -O2 {program.name}.c {program.name}_selftest.c -lm && ./a.out",
    ]


def _signature(program: Program, own: Function, kind: str, suffix: str) -> str:
    sizes = program.sizes(own)
    words = [
        f"{'' if word in own.outputs else 'const '}{kind} {word}[{sizes[word]}]" if word in ARRAYS else f"{kind} {word}"
        for word in own.arguments
    ]
    words += [f"{kind} {word}[{sizes[word]}]" for word in own.outputs if word not in own.arguments]
    return f"void {program.name}_{own.name}{suffix}({', '.join(words)})"


def dialect_of(name: str, kind: str, suffix: str) -> Dialect:
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


def _function(program: Program, own: Function, kind: str, suffix: str) -> dict[str, object]:
    """Write signature and body of a function."""
    asked = own.variables(lambda name, place: name).values()
    unused = [f"(void){given};" for given in own.arguments if given not in (*asked, "memory")]
    body = own.assignments(dialect_of(program.name, kind, suffix))
    return {"signature": _signature(program, own, kind, suffix), "body": [*body, *unused]}


def _selftest(program: Program) -> str:
    tracer, n = program.tracer, program.joints
    table, moved = states(tracer.model, _STATES), swing(tracer.model, _STATES)
    still, walked = expected(tracer, table, settled=True), expected(tracer, moved)
    return rendered(
        "selftest.c.j2",
        name=program.name,
        joints=n,
        memory=program.memory,
        more=[k * n for k in range(len(program.functions[-1].outputs) - 2)],  # beside tau and memory
        table=np.column_stack([*table, still]),
        moved=np.column_stack([*moved, walked]),
        oil=[tracer.carried.usual_oil for _ in tracer.oil],
        dt=repr(1.0 / tracer.model.machine.rate_hz),
        largest=repr(float(np.max(np.abs(np.vstack([still, walked])))) or 1.0),
        tolerance=TOLERANCE,
    )
