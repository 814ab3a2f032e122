"""The model in C99: no allocation, no state, no library but libm; doubles and floats.

A folder with ``<name>.h``, ``<name>.c`` and ``<name>_selftest.c``, which holds a table of states and of what the model
says of them, and exits with 1 where the compiled code says otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from daq.recordings.recording_files import replacing
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.export.printing import Dialect, curves_of, statements
from fitting.model.export.tracing.graph import Node, needed
from fitting.model.export.tracing.tracing import Tracer
from fitting.model.export.words import Written, heading, require_folder

FloatArray = npt.NDArray[np.float64]

#: States of the self-test, and the largest difference that passes, as a share of the largest effort.
_STATES = 24
TOLERANCE = {"double": 1e-9, "float": 2e-4}
_KEYWORDS = {"int", "float", "double", "long", "short", "char", "void", "for", "do", "if", "else", "while", "main"}

_HELPERS = {
    "sign": """static {T} {n}_sign{s}({T} x)
{{
    return ({T})((x > 0) - (x < 0));
}}""",
    "above": """static {T} {n}_above{s}({T} a, {T} b)
{{
    return ({T})(a > b);
}}""",
    "at_least": """static {T} {n}_at_least{s}({T} a, {T} b)
{{
    return ({T})(a >= b);
}}""",
    "curve": """/* Piecewise cubic, constant beyond its ends. */
static {T} {n}_curve{s}({T} x, const {T} *breaks, const {T} (*pieces)[4], int count)
{{
    int k = 0;
    {T} d;
    if (x < breaks[0]) {{
        x = breaks[0];
    }}
    if (x > breaks[count]) {{
        x = breaks[count];
    }}
    while (k < count - 1 && x >= breaks[k + 1]) {{
        ++k;
    }}
    d = x - breaks[k];
    return ((pieces[k][0] * d + pieces[k][1]) * d + pieces[k][2]) * d + pieces[k][3];
}}""",
    "smooth": """/* Expectation of far = |v|^p sgn v of a speed that was measured with normal noise: near zero by
 * Kummer's function, a sum of positive terms; beyond six noise widths by its asymptotic series. */
static {T} {n}_smooth{s}({T} v, {T} noise, {T} p, {T} factor, {T} far)
{{
    {T} u, z, term = 1, total = 1, k = 0;
    if (!(noise > 0)) {{
        return far;
    }}
    u = v / noise;
    if (fabs{s}(u) >= 6) {{
        z = 1 / (u * u);
        return far * (1 + p * (p - 1) / 2 * z * (1 + (p - 2) * (p - 3) / 4 * z));
    }}
    z = u * u / 2;
    while (k < 200 && term > ({T})1e-17 * total) {{
        term *= (1 + p / 2 + k) / (({T})1.5 + k) / (k + 1) * z;
        total += term;
        k += 1;
    }}
    return factor * u * exp{s}(-z) * total;
}}""",
    "power": """static {T} {n}_power{s}({T} v, {T} noise, {T} p, {T} factor)
{{
    const {T} far = pow{s}(fabs{s}(v), p);
    return {n}_smooth{s}(v, noise, p, factor, v < 0 ? -far : far);
}}""",
    "root": """static {T} {n}_root{s}({T} v, {T} noise, {T} p, {T} factor)
{{
    return {n}_smooth{s}(v, noise, p, factor, cbrt{s}(v));
}}""",
}


@dataclass(frozen=True)
class Function:
    """A function of the file: its name's end, letters of its inputs, whether it takes the time, outputs by name."""

    name: str
    letters: str
    timed: bool
    outputs: dict[str, tuple[Node, ...]]

    @property
    def nodes(self) -> list[Node]:
        """All outputs in a row."""
        return [node for own in self.outputs.values() for node in own]


def identifier(name: str) -> str:
    """A name that C takes, of a machine's."""
    word = re.sub(r"[^0-9a-z]+", "_", name.lower()).strip("_") or "arm"
    return f"arm_{word}" if word[0].isdigit() or word in _KEYWORDS else word


def functions_of(tracer: Tracer) -> list[Function]:
    """What an exported model can be asked."""
    state = tracer.variables()
    found = tracer.efforts(state)
    result = [
        Function("inverse_dynamics", "qva", True, {"tau": found.joint}),
        Function("drive_efforts", "qva", True, {"force": found.drive}),
        Function("gravity", "q", False, {"tau": tracer.gravity(state.q)}),
        Function("friction", "qv", True, {"tau": tracer.friction(state)}),
    ]
    head = tuple(node for node in found.head if node is not None)
    rod = tuple(node for node in found.rod if node is not None)
    if len(head) == len(rod) == len(found.joint):
        result.append(Function("pressures", "qva", True, {"head": head, "rod": rod}))
    return result


def write_c(model: ArmModel, path: Path) -> Written:
    """Write the model as C source in a folder.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(path)
    tracer = Tracer(model)
    files = c_files(tracer)
    for name, text in files.items():
        with replacing(path / name) as temporary:
            temporary.write_text(text, encoding="utf-8")
    return Written(tuple(path / name for name in files), tuple(tracer.left_out))


def c_files(tracer: Tracer) -> dict[str, str]:
    """Texts of the files by name."""
    name, functions = identifier(tracer.model.machine.name), functions_of(tracer)
    return {
        f"{name}.h": _header(tracer, name, functions),
        f"{name}.c": _source(tracer, name, functions),
        f"{name}_selftest.c": _selftest(tracer, name),
    }


def _comment(lines: Sequence[str]) -> str:
    return "\n".join(["/*", *(f" * {line}".replace("*/", "* /") for line in lines), " */"])


def _signature(name: str, own: Function, joints: int, kind: str, suffix: str) -> str:
    words = {"q": "q", "v": "qd", "a": "qdd"}
    inputs = [f"const {kind} {words[letter]}[{joints}]" for letter in own.letters] + [f"{kind} t"] * own.timed
    outputs = [f"{kind} {output}[{joints}]" for output in own.outputs]
    return f"void {name}_{own.name}{suffix}({', '.join([*inputs, *outputs])})"


def _header(tracer: Tracer, name: str, functions: Sequence[Function]) -> str:
    joints, guard = len(tracer.model.joints), f"{name.upper()}_H"
    said = [
        *heading(tracer),
        "",
        "Functions without suffix take doubles, those with suffix f floats. Arrays have a value per joint.",
        "inverse_dynamics: joint efforts; drive_efforts: N at a piston; friction: what turns with the speed's sign;",
        "pressures: those of the head, and those of the rod that the recordings show at such a motion.",
        f"Self-test: cc -std=c99 -O2 {name}.c {name}_selftest.c -lm && ./a.out",
    ]
    lines = [
        f"{_signature(name, own, joints, kind, suffix)};"
        for own in functions
        for kind, suffix in (("double", ""), ("float", "f"))
    ]
    return "\n".join(
        [
            _comment(said),
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            f"#define {name.upper()}_JOINTS {joints}",
            "",
            "#ifdef __cplusplus",
            'extern "C" {',
            "#endif",
            "",
            *lines,
            "",
            "#ifdef __cplusplus",
            "}",
            "#endif",
            "",
            "#endif",
            "",
        ]
    )


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


def _source(tracer: Tracer, name: str, functions: Sequence[Function]) -> str:
    nodes = needed([node for own in functions for node in own.nodes])
    curves = curves_of(nodes)
    parts = [f'#include "{name}.h"\n\n#include <math.h>']
    sizes = [f"#define {name.upper()}_PIECES_{k} {len(tracer.graph.curves[k].pieces)}" for k in curves]
    parts += ["\n".join(sizes)] if sizes else []
    for kind, suffix in (("double", ""), ("float", "f")):
        dialect = _dialect(name, kind, suffix)
        parts += [_table(tracer, name, k, kind, suffix, dialect) for k in curves]
        parts += [_HELPERS[word].format(T=kind, n=name, s=suffix) for word in _used(nodes)]
        parts += [_function(tracer, name, own, kind, suffix, dialect) for own in functions]
    return "\n\n".join(parts) + "\n"


def _used(nodes: Sequence[Node]) -> list[str]:
    """Helpers that some nodes ask for, in the order in which they are defined."""
    powers = [node for node in nodes if node.operation == "signed_power"]
    roots = [float(node.arguments[2]) == 1 / 3 for node in powers]
    wanted = {node.operation for node in nodes} & {"sign", "above", "at_least", "curve"}
    wanted |= {"smooth"} if powers else set()
    wanted |= ({"root"} if any(roots) else set()) | ({"power"} if not all(roots) else set())
    return [word for word in _HELPERS if word in wanted]


def _table(tracer: Tracer, name: str, number: int, kind: str, suffix: str, dialect: Dialect) -> str:
    curve = tracer.graph.curves[number]
    breaks = ", ".join(dialect.number(value) for value in curve.breaks.tolist())
    rows = ",\n".join(
        "    {" + ", ".join(dialect.number(value) for value in row) + "}" for row in curve.pieces.tolist()
    )
    return (
        f"static const {kind} {name}_breaks_{number}{suffix}[] = {{{breaks}}};\n"
        f"static const {kind} {name}_pieces_{number}{suffix}[][4] = {{\n{rows}\n}};"
    )


def _function(tracer: Tracer, name: str, own: Function, kind: str, suffix: str, dialect: Dialect) -> str:
    joints, words = len(tracer.model.joints), {"q": "q", "v": "qd", "a": "qdd"}
    named = {f"{letter}{j}": f"{words[letter]}[{j}]" for letter in own.letters for j in range(joints)} | {"t": "t"}
    targets = {f"{output}[{j}]": node for output, nodes in own.outputs.items() for j, node in enumerate(nodes)}
    lines, results = statements(targets, dialect, named)
    asked = {str(node.value) for node in needed(own.nodes) if node.operation == "variable"}
    unused = [f"    (void){words[letter]};" for letter in own.letters if not any(a[0] == letter for a in asked)]
    unused += ["    (void)t;"] if own.timed and "t" not in asked else []
    body = [*lines, *unused, *(f"    {target} = {word};" for target, word in results.items())]
    return "\n".join([_signature(name, own, joints, kind, suffix), "{", *body, "}"])


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


def _selftest(tracer: Tracer, name: str) -> str:
    q, qd, qdd, t = states(tracer.model, _STATES)
    efforts = motion.on_motion(tracer.carried, q, qd, qdd, t).joint_effort(0)
    dialect, joints = Dialect(), q.shape[1]
    rows = [
        "    {" + ", ".join(dialect.number(float(value)) for value in row) + "}"
        for row in np.hstack([q, qd, qdd, t[:, None], efforts])
    ]
    largest = dialect.number(float(np.max(np.abs(efforts))) or 1.0)
    return f"""/* Compares the compiled model with a table of what hilfit says: exits with 1 if they differ. */
#include "{name}.h"

#include <math.h>
#include <stdio.h>

/* q, qd, qdd, t, joint efforts */
static const double table[{len(rows)}][{4 * joints + 1}] = {{
{(f",{chr(10)}").join(rows)}
}};

int main(void)
{{
    double worst = 0, worst_float = 0;
    int row, k;
    for (row = 0; row < {len(rows)}; ++row) {{
        const double *state = table[row];
        const double *expected = state + {3 * joints + 1};
        double tau[{joints}];
        float single[{3 * joints}], tau_float[{joints}];
        for (k = 0; k < {3 * joints}; ++k) {{
            single[k] = (float)state[k];
        }}
        {name}_inverse_dynamics(state, state + {joints}, state + {2 * joints}, state[{3 * joints}], tau);
        {name}_inverse_dynamicsf(single, single + {joints}, single + {2 * joints}, (float)state[{3 * joints}],
                                 tau_float);
        for (k = 0; k < {joints}; ++k) {{
            worst = fmax(worst, fabs(tau[k] - expected[k]) / {largest});
            worst_float = fmax(worst_float, fabs((double)tau_float[k] - expected[k]) / {largest});
        }}
    }}
    printf("largest difference over the largest effort: doubles %.2g, floats %.2g\\n", worst, worst_float);
    return worst <= {TOLERANCE["double"]!r} && worst_float <= {TOLERANCE["float"]!r} ? 0 : 1;
}}
"""
