"""One conformance class for all formats that can be run: what an export answers, against what the model answers.

The judges are others: a C compiler, GNU Octave, fmpy. Moments are looked at one by one, and a motion in even steps one
moment after the other, so that what a model remembers counts.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import beyond
from fitting.model.export import export_model
from fitting.model.export.functions import identifier, states, swing
from fitting.model.export.tracing.tracing import tracer_of

#: What was asked, to what was answered, (N, n) each.
Answers = dict[str, FloatArray]

#: Settings under which the C has to compile without a word.
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O2")
#: What has to be installed for a format to be run, and how.
NEEDS: dict[str, tuple[Callable[[], bool], str]] = {
    "python": (lambda: True, ""),
    "c": (lambda: shutil.which("cc") is not None, "there is no C compiler (apt-get install gcc)"),
    "matlab": (lambda: octave() is not None, "there is no GNU Octave (apt-get install octave)"),
    "fmu": (
        lambda: find_spec("fmpy") is not None and shutil.which("cc") is not None,
        "fmpy or a C compiler is missing (pip install fmpy, apt-get install gcc)",
    ),
}
_MOMENTS, _STEPS = 200, 150


def octave() -> str | None:
    """GNU Octave, None where it is not installed."""
    return shutil.which("octave-cli") or shutil.which("octave")


class Conformance:
    """A model, the motions that its exports are tried on, and what the model says of them.

    Attributes
    ----------
    moments, moved : ``q, qd, qdd, t``: moments without order, and a motion in even steps
    remembers : whether the exports of the model have a memory
    right : what the model answers: the functions of one moment with histories settled; ``walk.*`` in the motion
    """

    def __init__(self, model: ArmModel, folder: Path) -> None:
        self.model, self.folder = model, folder
        tracer = tracer_of(model)
        carried, self.remembers = tracer.carried, bool(tracer.memory)
        settled = motion.at_rest(carried)
        self.moments, self.moved = states(model, _MOMENTS), swing(model, _STEPS)
        q, qd, _, _ = self.moments
        self.right: Answers = {
            "gravity": motion.gravity(settled, q),
            "friction": motion.friction(settled, q, qd),
            "beyond": beyond(model, motion.on_motion(settled, *self.moments).design.segments[0]).astype(float),
            **_of(settled, self.moments),
        }
        if self.remembers:
            names = {
                "tau": "inverse_dynamics",
                "force": "drive_efforts",
                "head": "head_pressures",
                "rod": "rod_pressures",
            }
            self.right |= {f"walk.{what}": own for what, own in _of(carried, self.moved, names).items()}
        self.name, self.joints = identifier(model.machine.name), q.shape[1]

    def differences(self, to: str) -> dict[str, float]:
        """Of each answer in a format the largest difference, as a share of the model's largest."""
        answers: Mapping[str, Answers] = {to: getattr(self, to)()} if to != "fmu" else self.fmu()
        return {
            f"{kind} {what}": float(np.max(np.abs(found - right)) / max(np.max(np.abs(right)), 1e-300))
            for kind, own in answers.items()
            for what, (found, right) in self._paired(own).items()
        }

    def _paired(self, answers: Answers) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Answers beside what is right; an answer to inputs of its own brings that along."""
        pairs = {what: (own, answers.get(f"right.{what}", self.right.get(what))) for what, own in answers.items()}
        found = {what: (own, right) for what, (own, right) in pairs.items() if right is not None}
        missing = [
            what for what in self.right if what not in found and not any(w.startswith("right.") for w in answers)
        ]
        if missing:
            raise AssertionError(f"the export does not answer {', '.join(missing)}")
        return found

    def python(self) -> Answers:
        """The module, on all rows at once."""
        export_model(self.model, "python", self.folder / "arm.py")
        own: dict[str, Any] = {}
        exec((self.folder / "arm.py").read_text(encoding="utf-8"), own)
        q, qd, qdd, t = self.moments
        found = {what: own[what](q, qd, qdd, t) for what in ("inverse_dynamics", "drive_efforts")}
        found |= {"gravity": own["gravity"](q), "friction": own["friction"](q, qd, np.zeros(len(t)))}
        found["beyond"] = own["beyond"](q, qd)
        for what in ("head_pressures", "rod_pressures"):
            found |= {what: own[what](q, qd, qdd, t)} if what in own else {}
        if not self.remembers:
            return found
        rows, dt, kept = [], 1.0 / self.model.machine.rate_hz, None
        for row in zip(*self.moved, strict=True):
            *said, kept = own["init"](*row, dt) if kept is None else own["step"](*row, dt, kept)
            rows.append(said)
        return found | self._walked(rows)

    def c(self) -> Answers:
        """The compiled source, after its own self-test."""
        folder, name, n = self.folder / "c", self.name, self.joints
        export_model(self.model, "c", folder)
        _run(["cc", *STRICT, "-o", "selftest", f"{name}.c", f"{name}_selftest.c", "-lm"], folder)
        _run([str(folder / "selftest")], folder)
        _run(["cc", *STRICT, "-fPIC", "-shared", "-o", "arm.so", f"{name}.c", "-lm"], folder)
        library, array = ctypes.CDLL(str(folder / "arm.so")), ctypes.c_double * n
        q, qd, qdd, t = self.moments

        def asked(function: str, given: list[FloatArray], outputs: int) -> list[FloatArray]:
            results = []
            for row in zip(*given, strict=True):
                out = [array() for _ in range(outputs)]
                inputs = [array(*own) if np.ndim(own) else ctypes.c_double(own) for own in row]
                getattr(library, f"{name}_{function}")(*inputs, *out)
                results.append([list(own) for own in out])
            return list(np.array(results).transpose(1, 0, 2))

        found = {what: asked(what, [q, qd, qdd, t], 1)[0] for what in ("inverse_dynamics", "drive_efforts")}
        found |= {"gravity": asked("gravity", [q], 1)[0], "friction": asked("friction", [q, qd, 0.0 * t], 1)[0]}
        found["beyond"] = asked("beyond", [q, qd], 1)[0]
        if "head_pressures" in self.right:
            found["head_pressures"], found["rod_pressures"] = asked("pressures", [q, qd, qdd, t], 2)
        if not self.remembers:
            return found
        memory = (ctypes.c_double * len(tracer_of(self.model).memory))()
        dt, rows = ctypes.c_double(1.0 / self.model.machine.rate_hz), []
        for k, row in enumerate(zip(*self.moved, strict=True)):
            out = [array() for _ in range(sum(what.startswith("walk.") for what in self.right))]
            given = [*(array(*own) for own in row[:3]), ctypes.c_double(row[3]), dt]
            if k == 0:
                getattr(library, f"{name}_init")(*given, *out, memory)
            else:
                getattr(library, f"{name}_step")(*given, memory, *out)
            rows.append([list(own) for own in out])
        return found | self._walked(rows)

    def _walked(self, rows: list[Any]) -> Answers:
        """Answers of a motion, moment by moment: efforts of joints and drives, pressures."""
        names = [what for what in self.right if what.startswith("walk.")]
        return dict(zip(names, np.array(rows).transpose(1, 0, 2), strict=True))

    def matlab(self) -> Answers:
        """The function file under GNU Octave."""
        judge, n = octave(), self.joints
        assert judge is not None
        export_model(self.model, "matlab", self.folder / f"{self.name}.m")
        for file, rows in (("moments", self.moments), ("moved", self.moved)):
            np.savetxt(self.folder / f"{file}.csv", np.column_stack(rows), delimiter=",", fmt="%.17g")
        split = [f"m(:, {k * n + 1}:{(k + 1) * n})" for k in range(3)]
        asked = {
            "inverse_dynamics": ("inverse_dynamics", "q, qd, qdd, t"),
            "drive_efforts": ("drive_efforts", "q, qd, qdd, t"),
            "gravity": ("gravity", "q"),
            "friction": ("friction", "q, qd"),
            "beyond": ("beyond", "q, qd"),
        }
        lines = ["m = csvread('moments.csv');", f"q = {split[0]}; qd = {split[1]}; qdd = {split[2]};"]
        lines += [f"t = m(:, {3 * n + 1});"]
        lines += [f"out.{what} = {self.name}('{function}', {given});" for what, (function, given) in asked.items()]
        if "head_pressures" in self.right:
            lines += [f"[out.head_pressures, out.rod_pressures] = {self.name}('pressures', q, qd, qdd, t);"]
        walk = [what.removeprefix("walk.") for what in self.right if what.startswith("walk.")]
        if walk:
            own, rate = ", ".join(walk), self.model.machine.rate_hz
            row = f"m(k, 1:{n}), m(k, {n + 1}:{2 * n}), m(k, {2 * n + 1}:{3 * n}), m(k, {3 * n + 1}), 1 / {rate!r}"
            lines += ["m = csvread('moved.csv');", "for k = 1:rows(m)", "if k == 1"]
            lines += [f"[{own}, memory] = {self.name}('init', {row});", "else"]
            lines += [f"[{own}, memory] = {self.name}('step', {row}, memory);", "end"]
            lines += [*(f"walk_{what}(k, :) = {what};" for what in walk), "end"]
            lines += [f"out.('walk.{what}') = walk_{what};" for what in walk]
        lines += ["for [v, name] = out", "dlmwrite([name '.out'], v, 'precision', 17);", "end"]
        (self.folder / "ask.m").write_text("\n".join(lines) + "\n", encoding="utf-8")
        _run([judge, "--no-gui", "--norc", "ask.m"], self.folder)
        return {what: np.loadtxt(self.folder / f"{what}.out", delimiter=",", ndmin=2) for what in self.right}

    def fmu(self) -> dict[str, Answers]:
        """Both units in both ways, on the motion; each is right about the inputs that fmpy says it gave."""
        done = export_model(self.model, "fmu", self.folder / "fmu")
        return {
            f"FMI {version} {kind}": self._unit(path, kind)
            for path, version in zip(done.files, (3, 2), strict=True)
            for kind in ("CoSimulation", "ModelExchange")
        }

    def _unit(self, path: Path, kind: str) -> Answers:
        from fmpy import simulate_fmu

        q, qd, qdd, t = self.moved
        words = ("q", "qd", "qdd")
        names = [f"{word}[{joint + 1}]" for word in words for joint in range(self.joints)]
        inputs = np.zeros(len(t), dtype=[("time", float), *((own, float) for own in names)])
        inputs["time"] = t
        for own, values in zip(names, np.column_stack([q, qd, qdd]).T, strict=True):
            inputs[own] = values
        outputs = ["effort", "drive", "gravity", *(["head", "rod"] if "head_pressures" in self.right else [])]
        step = 1.0 / self.model.machine.rate_hz
        found = simulate_fmu(
            str(path),
            fmi_type=kind,
            input=inputs,
            output=[*names, *(f"{word}[{k + 1}]" for word in outputs for k in range(self.joints))],
            start_time=0.0,
            stop_time=float(t[-1]),
            output_interval=step,
            step_size=step,
            solver="Euler",
        )

        def columns(word: str) -> FloatArray:
            return np.column_stack([found[f"{word}[{joint + 1}]"] for joint in range(self.joints)])

        carried = tracer_of(self.model).carried
        given = (*(columns(word) for word in words), step * np.arange(len(found)))
        named = {
            "effort": "inverse_dynamics",
            "drive": "drive_efforts",
            "head": "head_pressures",
            "rod": "rod_pressures",
        }
        right = _of(carried, given, named)
        right["gravity"] = motion.gravity(carried, given[0])
        answers = {word: columns(word) for word in outputs}
        return answers | {f"right.{word}": right[word] for word in outputs}


def _of(
    model: ArmModel, moved: tuple[npt.NDArray[np.floating[Any]], ...], names: Mapping[str, str] | None = None
) -> Answers:
    """Efforts and pressures of a motion by the model, under the names of the functions or of the outputs."""
    found = motion.on_motion(model, *moved)
    head, rod = motion.pressures(model, *moved)
    says = {"inverse_dynamics": found.joint_effort(0), "drive_efforts": found.drive_effort(0)}
    says |= {"head_pressures": head, "rod_pressures": rod} if np.isfinite(head).all() else {}
    return says if names is None else {name: says[what] for name, what in names.items() if what in says}


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode != 0:
        raise AssertionError(f"{command[0]} says: {(done.stderr or done.stdout).strip()[:400]}")
