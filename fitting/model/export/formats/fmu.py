"""The model as functional mock-up units, FMI 3.0 and FMI 2.0: blocks of the exported C for simulators.

Positions, speeds and accelerations go in; efforts, gravity, friction and pressures come out, of the same moment. What
a model remembers is kept from one communication point, or accepted step of the integrator, to the next. Units with
``forward`` in their names go the other way, for Co-Simulation: efforts and pressures go in, the motion comes out, and
positions and speeds are their states. All hold their sources; the C compiler of this computer makes the binaries of
its platform.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from daq.errors import InputError
from daq.whole_files import replacing
from fitting.model.arm_model import ArmModel
from fitting.model.export.formats.c import c_files, forward_files
from fitting.model.export.functions import Program, forward_program, program_of, rendered
from fitting.model.export.words import Written, model_card, require_folder

#: Units by what SI makes of them: exponents of kg, m, s, rad.
_UNITS = {
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "1": {},
    "K": {"K": 1},
    "Pa": {"kg": 1, "m": -1, "s": -2},
}
_MOTION = {"q": "position", "qd": "speed", "qdd": "acceleration"}
#: Output of a function of the C, its name in the unit, what it is.
_OUTPUTS = {
    ("inverse_dynamics", "tau"): ("effort", "effort that the motion takes"),
    ("gravity", "tau"): ("gravity", "effort that holds the links still"),
    ("friction", "tau"): ("friction", "effort that changes its sign with the speed's"),
    ("drive_efforts", "force"): ("drive", "effort of the drive"),
    ("beyond", "flag"): ("beyond", "1 where the motion is beyond what was recorded"),
    ("pressures", "head"): ("head", "head pressure"),
    ("pressures", "rod"): ("rod", "rod pressure"),
}
_PLACES = {"linux": "linux", "darwin": "darwin", "win32": "windows"}
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}


@dataclass(frozen=True)
class Variable:
    """A variable of a unit: its value reference is its place, 1 the first; 0 is the time.

    Attributes
    ----------
    name, unit, description : of it
    causality : ``parameter``, ``input`` or ``output``
    start : value before any is set; of an output none
    """

    name: str
    unit: str
    description: str
    causality: str
    start: float = 0.0


@dataclass(frozen=True)
class Unit:
    """A unit before it is packed.

    Attributes
    ----------
    name, title : of its files, and for people
    token : what no other model has
    kinds : interfaces of FMI
    variables : parameters and inputs, then outputs
    sources, resources : texts of the C, and of what lies beside it, by name
    words : what ``fmi_instance.h`` is made of beside them
    step : s between the samples of the recordings, where that means something to the unit
    """

    name: str
    title: str
    token: str
    kinds: tuple[str, ...]
    variables: tuple[Variable, ...]
    sources: Mapping[str, str]
    words: Mapping[str, Any]
    step: float | None = None
    resources: Mapping[str, str] = field(default_factory=dict)


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write in a folder ``NAME_fmi3.fmu`` and ``NAME_fmi2.fmu``, and with ``forward`` in their names those of motions.

    Without a C compiler (``cc``) they hold sources only, and that is reported.

    Raises
    ------
    InputError
        If the folder is a file, or the compiler refuses.
    """
    program = program_of(model)
    forward, lines = forward_program(program.tracer.model, possible)
    units = [_inverse(program), *([] if forward is None else [_forward(forward)])]
    return write_units(path, units, [*program.tracer.left_out, *lines], lambda out: model_card(model, out))


def write_units(
    path: Path, units: Sequence[Unit], left_out: Sequence[str], card: Callable[[Sequence[str]], list[str]]
) -> Written:
    """Write units in a folder, each for both versions of FMI; ``card`` makes their description of what is left out."""
    require_folder(path)
    compiler = shutil.which("cc")
    if compiler is None:
        left_out = [*left_out, "binaries: there is no C compiler (cc) here; the units hold sources"]
    targets = [
        _packed(path / f"{unit.name}_fmi{version}.fmu", unit, version, card(left_out), compiler)
        for unit in units
        for version in (3, 2)
    ]
    return Written(tuple(targets), tuple(left_out))


def _packed(target: Path, unit: Unit, version: int, card: Sequence[str], compiler: str | None) -> Path:
    """Write a unit."""
    starts = [own.start for own in unit.variables if own.causality != "output"]
    token = f"{{{uuid5(NAMESPACE_URL, unit.name + unit.token)}}}"
    words: dict[str, Any] = {"name": unit.name, "token": token, "step": unit.step}
    instance = rendered(
        "fmi_instance.h.j2", starts=starts, outputs=len(unit.variables) - len(starts), **words, **unit.words
    )
    sources = {**unit.sources, "fmi_instance.h": instance, "fmi.c": rendered(f"fmi{version}.c")}
    content: dict[str, bytes] = {f"sources/{file}": text.encode() for file, text in sources.items()}
    content |= {f"resources/{file}": text.encode() for file, text in unit.resources.items()}
    about: dict[str, Any] = {"title": unit.title, "units": _UNITS, "card": card}
    about |= {"variables": unit.variables, "kinds": unit.kinds, "version": version, "new": version == 3}
    content["modelDescription.xml"] = rendered("modelDescription.xml.j2", **words, **about).encode()
    if version == 3:
        content["sources/buildDescription.xml"] = rendered("buildDescription.xml.j2", name=unit.name).encode()
    if compiler is not None:
        folder, suffix = binary_place(version)
        content[f"binaries/{folder}/{unit.name}{suffix}"] = _compiled(compiler, sources)
    with replacing(target) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for file, data in content.items():
            archive.writestr(file, data)
    return target


def binary_place(version: int) -> tuple[str, str]:
    """Return the folder of this platform's binaries in a unit, and suffix."""
    system = _PLACES.get(sys.platform, sys.platform)
    machine = _MACHINES.get(platform.machine().lower(), platform.machine().lower())
    suffix = {"windows": ".dll", "darwin": ".dylib"}.get(system, ".so")
    if version == 3:
        return f"{machine}-{system}", suffix
    bits = "64" if sys.maxsize > 2**32 else "32"
    short = {"windows": "win"}.get(system, system)
    return (f"{short}{bits}" if machine == "x86_64" else f"{machine}-{short}"), suffix


def _each(model: ArmModel, word: str, description: str, causality: str, starts: Sequence[float] = ()) -> list[Variable]:
    """Make a variable per joint; the word names its owner: a joint's (``q``, ``effort``), or a drive's."""
    result = []
    for number, joint in enumerate(model.machine.joints):
        turns, cylinder = joint.type == "revolute", model.arm.joints[number].cylinder is not None
        effort = "N.m" if turns and not (word == "drive" and cylinder) else "N"
        per = {"q": "", "qd": "/s", "qdd": "/s2"}.get(word.removesuffix("_start"))
        unit = {"head": "Pa", "rod": "Pa", "beyond": "1"}.get(word, effort)
        unit = unit if per is None else ("rad" if turns else "m") + per
        start = starts[number] if len(starts) else 0.0
        result.append(Variable(f"{word}[{number + 1}]", unit, f"{description} of {joint.name}", causality, start))
    return result


def _inverse(program: Program) -> Unit:
    """Make efforts of a moment; memory of the moments before it."""
    n, model = program.joints, program.tracer.model
    variables = [v for word, description in _MOTION.items() for v in _each(model, word, description, "input")]
    given = {word: f"in + {k * n}" for k, word in enumerate(_MOTION)}
    given |= {"t": "arm->values[0]", "dt": "dt", "memory": "arm->memory", "temperature": f"in[{3 * n}]"}
    if model.temperature is not None or program.tracer.oil:
        variables.append(_oil(model))
    outputs = [
        (own.name, output) for own in program.functions for output in own.outputs if (own.name, output) in _OUTPUTS
    ]
    variables += [v for own in outputs for v in _each(model, *_OUTPUTS[own], "output")]
    places = {own: f"out + {k * n}" for k, own in enumerate(outputs)}
    same = {"tau": "inverse_dynamics", "force": "drive_efforts", "head": "pressures", "rod": "pressures"}
    calls = {}
    for own in program.functions:
        taken = [
            places.get((own.name, output)) or places.get((same.get(output, ""), output), given.get(output, ""))
            for output in own.outputs
            if output not in own.arguments
        ]
        calls[own.name] = f"{program.name}_{own.name}({', '.join([*(given[word] for word in own.arguments), *taken])});"
    words = {"calls": calls, "memory": program.memory, "moving": 0}
    return _unit(program, ("ModelExchange", "CoSimulation"), variables, c_files(program), words)


def _forward(program: Program) -> Unit:
    """Make motion from efforts and pressures, held from one communication point to the next."""
    model = program.tracer.model
    middle = [sum(joint.limits.position) / 2 for joint in model.machine.joints]
    variables = [
        *_each(model, "q_start", "position at the beginning", "parameter", middle),
        *_each(model, "qd_start", "speed at the beginning", "parameter"),
        *_each(model, "effort", "effort beside that of the pressures", "input"),
        *_each(model, "head", "head pressure", "input"),
        *_each(model, "rod", "rod pressure", "input"),
        *(_oil(model) for _ in program.tracer.oil),
        *(v for word, description in _MOTION.items() for v in _each(model, word, description, "output")),
    ]
    oil = f", arm->values[{1 + 5 * program.joints}]" if program.tracer.oil else ""
    words = {"calls": {}, "memory": 0, "moving": program.joints, "oil": oil}
    return _unit(program, ("CoSimulation",), variables, forward_files(program), words)


def _oil(model: ArmModel) -> Variable:
    return Variable("temperature", "K", "temperature of the oil", "input", model.usual_oil)


def _unit(
    program: Program, kinds: tuple[str, ...], variables: list[Variable], sources: Mapping[str, str], words: Any
) -> Unit:
    """Make a unit of an arm."""
    model = program.tracer.model
    name, made = model.machine.name, model.provenance
    parts = [name, made.created, made.calibration or "", *(source.sha256 for source in made.data)]
    token = " ".join([*parts, *map(repr, model.theta.tolist())])
    return Unit(program.name, name, token, kinds, tuple(variables), sources, words, 1.0 / model.machine.rate_hz)


def _compiled(compiler: str, sources: Mapping[str, str]) -> bytes:
    """Compile the library."""
    with tempfile.TemporaryDirectory(prefix="hilfit-") as name:
        folder = Path(name)
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        units = [file for file in sources if file.endswith(".c")]
        flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden"]
        done = subprocess.run(
            [compiler, *flags, "-o", "arm", *units, "-lm"], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            line = next(iter(done.stderr.strip().splitlines()), "no reason given")
            raise InputError("fitting.export_compiler_refuses", compiler=compiler, line=line)
        return (folder / "arm").read_bytes()
