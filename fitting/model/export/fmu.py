"""The model as functional mock-up units, FMI 3.0 and FMI 2.0: blocks of the exported C for simulators.

Positions, speeds and accelerations go in; efforts, gravity, friction and pressures come out, of the same moment. What
a model remembers is kept from one communication point, or accepted step of the integrator, to the next. Both units
serve Model Exchange and Co-Simulation and hold their sources; the C compiler of this computer makes the binaries of its
platform.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from daq.errors import InputError
from daq.recordings.recording_files import replacing
from fitting.model.arm_model import ArmModel
from fitting.model.export.c import c_files
from fitting.model.export.functions import Function, functions_of, identifier, rendered
from fitting.model.export.tracing.tracing import Tracer, tracer_of
from fitting.model.export.words import Written, require_folder, said_of

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
    "Pa": {"kg": 1, "m": -1, "s": -2},
}
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
    """A variable of a unit: its value reference is its place, 1 the first; 0 is the time."""

    name: str
    unit: str
    says: str
    output: bool


def write_fmu(model: ArmModel, path: Path) -> Written:
    """Write ``NAME_fmi3.fmu`` and ``NAME_fmi2.fmu`` in a folder.

    Without a C compiler (``cc``) they hold sources only, and that is said.

    Raises
    ------
    InputError
        If the folder is a file, or the compiler refuses.
    """
    require_folder(path)
    tracer = tracer_of(model)
    name, functions = identifier(model.machine.name), functions_of(tracer)
    left_out = list(tracer.left_out)
    compiler = shutil.which("cc")
    if compiler is None:
        left_out.append("binaries: there is no C compiler (cc) here; the units hold sources")
    written = []
    for version in (3, 2):
        sources = _sources(tracer, name, functions, version)
        content: dict[str, bytes] = {f"sources/{file}": text.encode() for file, text in sources.items()}
        words: dict[str, Any] = {
            "name": name,
            "title": model.machine.name,
            "token": _token(model),
            "step": _step(model),
            "units": _UNITS,
        }
        words |= {"said": said_of(model, left_out), "variables": variables_of(model, functions)}
        description = rendered("modelDescription.xml.j2", version=version, new=version == 3, **words)
        content["modelDescription.xml"] = description.encode()
        if version == 3:
            content["sources/buildDescription.xml"] = rendered("buildDescription.xml.j2", name=name).encode()
        if compiler is not None:
            folder, suffix = binary_place(version)
            content[f"binaries/{folder}/{name}{suffix}"] = _compiled(compiler, sources)
        target = path / f"{name}_fmi{version}.fmu"
        with replacing(target) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for file, data in content.items():
                archive.writestr(file, data)
        written.append(target)
    return Written(tuple(written), tuple(left_out))


def binary_place(version: int) -> tuple[str, str]:
    """Folder of this platform's binaries in a unit, and their suffix."""
    system = _PLACES.get(sys.platform, sys.platform)
    machine = _MACHINES.get(platform.machine().lower(), platform.machine().lower())
    suffix = {"windows": ".dll", "darwin": ".dylib"}.get(system, ".so")
    if version == 3:
        return f"{machine}-{system}", suffix
    bits = "64" if sys.maxsize > 2**32 else "32"
    short = {"windows": "win"}.get(system, system)
    return (f"{short}{bits}" if machine == "x86_64" else f"{machine}-{short}"), suffix


def variables_of(model: ArmModel, functions: Sequence[Function]) -> list[Variable]:
    """Inputs and outputs in the order of their value references."""
    turning = [joint.type == "revolute" for joint in model.machine.joints]
    result = []
    for word, per in (("q", ""), ("qd", "/s"), ("qdd", "/s2")):
        what = {"q": "position", "qd": "speed", "qdd": "acceleration"}[word]
        for joint, (name, turns) in enumerate(zip(model.joints, turning, strict=True)):
            unit = ("rad" if turns else "m") + per
            result.append(Variable(f"{word}[{joint + 1}]", unit, f"{what} of {name}", False))
    for own in functions:
        for output in own.outputs if own.name not in ("init", "step") else ():
            word, says = _OUTPUTS[own.name, output]
            for joint, (name, turns) in enumerate(zip(model.joints, turning, strict=True)):
                cylinder = model.arm.joints[joint].cylinder is not None
                unit = "N.m" if turns and not (word == "drive" and cylinder) else "N"
                unit = {"pressures": "Pa", "beyond": "1"}.get(own.name, unit)
                result.append(Variable(f"{word}[{joint + 1}]", unit, f"{says}, {name}", True))
    return result


def _sources(tracer: Tracer, name: str, functions: Sequence[Function], version: int) -> dict[str, str]:
    """Texts of the C by name."""
    n = len(tracer.model.joints)
    given = {word: f"in + {k * n}" for k, word in enumerate(("q", "qd", "qdd"))}
    given |= {"t": "arm->values[0]", "dt": "dt", "memory": "arm->memory"}
    outputs = [(own.name, output) for own in functions for output in own.outputs if (own.name, output) in _OUTPUTS]
    places = {own: f"out + {k * n}" for k, own in enumerate(outputs)}
    same = {"tau": "inverse_dynamics", "force": "drive_efforts", "head": "pressures", "rod": "pressures"}
    calls = {}
    for own in functions:
        taken = [
            places.get((own.name, output)) or places.get((same.get(output, ""), output), given.get(output, ""))
            for output in own.outputs
            if output not in own.arguments
        ]
        calls[own.name] = f"{name}_{own.name}({', '.join([*(given[word] for word in own.arguments), *taken])});"
    words = {"name": name, "token": _token(tracer.model), "inputs": 3 * n, "outputs": n * len(outputs)}
    return {
        **c_files(tracer, functions),
        "fmi_instance.h": rendered(
            "fmi_instance.h.j2", calls=calls, memory=len(tracer.memory), step=_step(tracer.model), **words
        ),
        "fmi.c": rendered(f"fmi{version}.c"),
    }


def _step(model: ArmModel) -> str:
    """Seconds between the samples of the recordings."""
    return repr(1.0 / model.machine.rate_hz)


def _token(model: ArmModel) -> str:
    """A name that no other model has."""
    made = model.provenance
    parts = [model.machine.name, made.created, made.calibration or "", *(source.sha256 for source in made.data)]
    return f"{{{uuid5(NAMESPACE_URL, ' '.join([*parts, *map(repr, model.theta.tolist())]))}}}"


def _compiled(compiler: str, sources: Mapping[str, str]) -> bytes:
    """The library that the compiler makes."""
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
            raise InputError(f"export: the C compiler {compiler} refuses the unit: {line}")
        return (folder / "arm").read_bytes()
