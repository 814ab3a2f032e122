"""One conformance class for all formats that can be run: what an export answers, against what the model answers.

The judges are others: a C compiler, GNU Octave, fmpy. Moments are looked at one by one, and a motion in even steps one
moment after the other, so that what a model remembers counts.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.exports.structured_text import Library
from benchmarks.pages import filled
from fitting.arrays import FloatArray
from fitting.loop.refits import final_model
from fitting.loop.session import Session
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import beyond
from fitting.model.export import export_model
from fitting.model.export.functions import identifier, program_of, states, swing
from fitting.model.export.tracing.tracing import tracer_of
from fitting.model.export.words import Written
from fitting.model.handover import hand_over
from fitting.model.simulation import simulate
from fitting.residual.terms import Term
from fitting.signals.corrections import Corrections

#: What was asked, to what was answered, (N, n) each.
Answers = dict[str, FloatArray]
#: What a motion is asked for: efforts of joints and of drives, pressures.
FUNCTIONS = ("inverse_dynamics", "drive_efforts", "head_pressures", "rod_pressures")
#: Answers of a function (its name, its arguments, how many outputs) at one moment.
Ask = Callable[[str, Sequence[Any], int], list[Any]]
#: ``q, qd, qdd, t``.
Moved = tuple[npt.NDArray[np.floating[Any]], ...]

#: Settings under which the C has to compile without a warning.
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O2")
#: What has to be installed for a format to be run, and how.
NEEDS: dict[str, tuple[Callable[[], bool], str]] = {
    "python": (lambda: True, ""),
    "st": (lambda: True, ""),
    "c": (lambda: shutil.which("cc") is not None, "there is no C compiler (apt-get install gcc)"),
    "matlab": (lambda: _octave() is not None, "there is no GNU Octave (apt-get install octave)"),
    "fmu": (
        lambda: find_spec("fmpy") is not None and shutil.which("cc") is not None,
        "fmpy or a C compiler is missing (pip install fmpy, apt-get install gcc)",
    ),
}
_MOMENTS, _STEPS = 200, 150
#: Seconds of a motion from efforts.
_FORWARD_S = 0.2


def _octave() -> str | None:
    """Find GNU Octave, None where it is not installed."""
    return shutil.which("octave-cli") or shutil.which("octave")


class Conformance:
    """A model, the motions that its exports are tried on, and what the model answers.

    Attributes
    ----------
    moments, moved : ``q, qd, qdd, t``: moments without order, and a motion in even steps
    memory : how many numbers the exports of the model keep from moment to moment
    oil : temperature of the oil, K
    arguments : of every function of the exports, in their order
    right : what the model answers: the functions of one moment with histories settled; ``walk.*`` in the motion
    gone : what the format last written says to leave out, by the name of each
    """

    def __init__(self, model: ArmModel, folder: Path, oil: float | None = None) -> None:
        self.model, self.folder = model, folder
        program = program_of(model)
        carried, self.memory = program.tracer.carried, program.memory
        settled = motion.at_rest(carried)
        self.moments, self.moved = states(model, _MOMENTS), swing(model, _STEPS)
        self.oil = model.usual_oil if oil is None else oil
        self.arguments = {own.name: own.arguments for own in program.functions}
        q, qd, _, _ = self.moments
        self.right: Answers = {
            "gravity": motion.gravity(settled, q, temperature=self.oil),
            "friction": motion.friction(settled, q, qd, temperature=self.oil),
            "beyond": self._beyond(settled, self.moments),
            **self._of(settled, self.moments),
        }
        if self.memory:
            walked = self._of(carried, self.moved, ("tau", "force", "head", "rod"))
            self.right |= {f"walk.{what}": own for what, own in walked.items()}
        self.name, self.joints = identifier(model.machine.name), q.shape[1]
        self.gone: set[str] = set()

    def exported(self, to: str, path: Path) -> Written:
        """Export the model, and note what is left out."""
        done = export_model(self.model, to, path)
        self.gone = {line.partition(":")[0] for line in done.left_out}
        return done

    def differences(self, to: str) -> dict[str, float]:
        """Compute for each answer in a format the largest difference, as a share of the model's largest."""
        answers: Mapping[str, Answers] = {to: getattr(self, to)()} if to != "fmu" else self.fmu()
        return {
            f"{kind} {what}": float(np.max(np.abs(found - right)) / max(np.max(np.abs(right)), 1e-300))
            for kind, own in answers.items()
            for what, (found, right) in self._paired(own).items()
        }

    def given(self, function: str, moved: Sequence[Any] | None = None) -> list[Any]:
        """Return arguments of a function in order: rows, or one row; those of the moments if None; no memory."""
        q, qd, qdd, t = self.moments if moved is None else moved
        known = {"q": q, "qd": qd, "qdd": qdd, "t": 0.0 * t if function == "friction" else t, "memory": None}
        known |= {"dt": 1.0 / self.model.machine.rate_hz, "temperature": self.oil + 0.0 * t}
        return [known[word] for word in self.arguments[function]]

    @property
    def _functions(self) -> dict[str, list[str]]:
        """Questions on one moment, by function: the names of their answers."""
        return {
            name: ["head_pressures", "rod_pressures"] if name == "pressures" else [name]
            for name in self.arguments
            if name not in ("init", "step")
        }

    def _paired(self, answers: Answers) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Pair answers with what is right; an answer to inputs of its own brings that along."""
        pairs = {what: (own, answers.get(f"right.{what}", self.right.get(what))) for what, own in answers.items()}
        found = {what: (own, right) for what, (own, right) in pairs.items() if right is not None}
        if both := self.gone & found.keys():
            raise AssertionError(f"the export has {', '.join(sorted(both))}, and says that it is left out")
        missing = [what for what in self.right if what not in found]
        if missing and not any(what.startswith("right.") for what in answers):
            raise AssertionError(f"the export does not answer {', '.join(missing)}")
        return found

    def _row_by_row(self, ask: Ask) -> Answers:
        """Ask every function at each moment by itself, and then the motion."""
        found: Answers = {}
        for function, whats in self._functions.items():
            rows = [ask(function, row, len(whats)) for row in zip(*self.given(function), strict=True)]
            found |= dict(zip(whats, np.array(rows).transpose(1, 0, 2), strict=True))
        return found | self._walked(ask)

    def _walked(self, ask: Ask) -> Answers:
        """Ask for the motion, moment by moment, where the model remembers: efforts of joints and drives, pressures."""
        names = [what for what in self.right if what.startswith("walk.")]
        if not names:
            return {}
        rows = []
        for k, row in enumerate(zip(*self.moved, strict=True)):
            name = "step" if k else "init"
            rows.append(ask(name, self.given(name, row), len(names)))
        return dict(zip(names, np.array(rows).transpose(1, 0, 2), strict=True))

    def python(self) -> Answers:
        """Call the module, on all rows at once."""
        self.exported("python", self.folder / "arm.py")
        own: dict[str, Any] = {}
        exec((self.folder / "arm.py").read_text(encoding="utf-8"), own)
        memory: Any = None

        def ask(function: str, given: Sequence[Any], _: int) -> list[Any]:
            nonlocal memory
            *answers, memory = own[function](*(memory if value is None else value for value in given))
            return list(answers)

        found = {
            what: own[what](*self.given(function)) for function, whats in self._functions.items() for what in whats
        }
        return found | self._walked(ask)

    def c(self) -> Answers:
        """Run the compiled source, after its own self-test."""
        folder = self.folder / "c"
        ask = c_functions(self.model, folder)
        run(["cc", *STRICT, "-o", "selftest", f"{self.name}.c", f"{self.name}_selftest.c", "-lm"], folder)
        run([str(folder / "selftest")], folder)
        return self._row_by_row(ask)

    def st(self) -> Answers:
        """Run the text, moment by moment, by an interpreter of the language's grammar."""
        self.exported("st", self.folder / "arm.st")
        library = Library((self.folder / "arm.st").read_text(encoding="utf-8"))
        words, memory = {"t": "t_s", "dt": "dt_s"}, [0.0] * self.memory
        functions = (*self._functions, *(("init", "step") if self.memory else ()))
        blocks = {function: library.block(f"{self.name}_{function}") for function in functions}

        def ask(function: str, given: Sequence[Any], _: int) -> list[Any]:
            named = dict(zip(self.arguments[function], given, strict=True))
            if function in ("init", "step"):
                named["memory"] = memory
            plain = {
                words.get(word, word): own.tolist() if isinstance(own, np.ndarray) else own
                for word, own in named.items()
            }
            return list(blocks[function](**plain).values())

        return self._row_by_row(ask)

    def matlab(self) -> Answers:
        """Run the function file under GNU Octave."""
        judge, n = _octave(), self.joints
        assert judge is not None
        self.exported("matlab", self.folder / f"{self.name}.m")
        for file, rows in (("moments", self.moments), ("moved", self.moved)):
            np.savetxt(self.folder / f"{file}.csv", np.column_stack(rows), delimiter=",", fmt="%.17g")
        walk = [what.removeprefix("walk.") for what in self.right if what.startswith("walk.")]
        asked = filled(
            "exports/ask.m.j2", arm=self.name, n=n, oil=repr(self.oil), rate=repr(self.model.machine.rate_hz),
            functions=self._functions, arguments=self.arguments, walk=walk,
        )  # fmt: skip
        (self.folder / "ask.m").write_text(asked, encoding="utf-8")
        run([judge, "--no-gui", "--norc", "ask.m"], self.folder)
        return {what: np.loadtxt(self.folder / f"{what}.out", delimiter=",", ndmin=2) for what in self.right}

    def fmu(self) -> dict[str, Answers]:
        """Run both units in both ways on the motion; each is right about the inputs that fmpy reports."""
        done = self.exported("fmu", self.folder / "fmu")
        return {
            f"FMI {version} {kind}": self._unit(path, kind)
            for path, version in zip(done.files[:2], (3, 2), strict=True)
            for kind in ("CoSimulation", "ModelExchange")
        }

    def forward(self) -> dict[str, float]:
        """Compare motions under held efforts, in C and as units: largest difference from the simulation's q and qd.

        As a share of what each goes through; of a model that can move.
        """
        model, n, folder = motion.nearest_possible(self.model), self.joints, self.folder / "forward"
        middle = model.limits.mean(axis=0)
        held = motion.gravity(model, middle, temperature=self.oil)[0]
        rest = motion.inertia_matrix(model, middle)[0].diagonal()
        rub = motion.friction(model, middle, 0.1 + 0.0 * middle, temperature=self.oil)[0]
        effort = held + (4.0 * np.abs(rest) + 1.2 * np.abs(rub)) * np.sin(1.0 + np.arange(n))
        right = simulate(model, lambda *_: effort, middle, seconds=_FORWARD_S, temperature=self.oil, within_s=600.0)
        ends, through = np.concatenate([right.q[-1], right.qd[-1]]), np.ptp(np.hstack([right.q, right.qd]), axis=0)
        export_model(model, "c", folder)
        name, array = f"{self.name}_forward", ctypes.c_double * n
        library, state = compiled(folder, f"{name}.c"), (ctypes.c_double * (2 * n + 1))()
        getattr(library, f"{name}_init")(array(*middle), array(), state)
        oil = [ctypes.c_double(self.oil)] if motion.heated(program_of(model).tracer.carried) else []
        now, ahead = ctypes.c_double(0.0), ctypes.c_double(_FORWARD_S)
        getattr(library, f"{name}_step")(state, array(*effort), now, *oil, ahead)
        found = {"C": np.array(state[: 2 * n])}
        for path in export_model(model, "fmu", folder).files if NEEDS["fmu"][0]() else ():
            if "_forward_" in path.name:
                found[path.stem.rpartition("_")[2]] = self._moved_unit(path, middle, effort)
        return {what: float(np.max(np.abs(own - ends) / through)) for what, own in found.items()}

    def _moved_unit(self, path: Path, start: FloatArray, effort: FloatArray) -> FloatArray:
        from fmpy import simulate_fmu

        given = {
            f"{word}[{k + 1}]": own
            for word, row in (("q_start", start), ("effort", effort))
            for k, own in enumerate(row)
        }
        names = [f"{word}[{k + 1}]" for word in ("q", "qd") for k in range(self.joints)]
        step = 1.0 / self.model.machine.rate_hz
        times = {"stop_time": _FORWARD_S, "output_interval": step, "step_size": step}
        found = simulate_fmu(str(path), start_values=given, output=names, **times)
        return np.array([found[name][-1] for name in names])

    def _unit(self, path: Path, kind: str) -> Answers:
        from fmpy import simulate_fmu

        q, qd, qdd, t = self.moved
        words = ("q", "qd", "qdd")
        names = [f"{word}[{joint + 1}]" for word in words for joint in range(self.joints)]
        inputs = np.zeros(len(t), dtype=[("time", float), *((own, float) for own in names)])
        inputs["time"] = t
        for own, values in zip(names, np.column_stack([q, qd, qdd]).T, strict=True):
            inputs[own] = values
        outputs = ["effort", "drive", "gravity", "beyond", *(["head", "rod"] if "head_pressures" in self.right else [])]
        step = 1.0 / self.model.machine.rate_hz
        found = simulate_fmu(
            str(path),
            fmi_type=kind,
            input=inputs,
            output=[*names, *(f"{word}[{k + 1}]" for word in outputs for k in range(self.joints))],
            start_values={word: self.oil for own in self.arguments.values() for word in own if word == "temperature"},
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
        right = self._of(carried, given, ("effort", "drive", "head", "rod"))
        right["gravity"] = motion.gravity(motion.at_rest(carried), given[0], temperature=self.oil)
        right["beyond"] = self._beyond(carried, given)
        answers = {word: columns(word) for word in outputs}
        return answers | {f"right.{word}": right[word] for word in outputs}

    def _of(self, model: ArmModel, moved: Moved, names: Sequence[str] = FUNCTIONS) -> Answers:
        """Compute efforts of joints and drives, and pressures (where there are any), of a motion by the model."""
        found = motion.on_motion(model, *moved, temperature=self.oil)
        head, rod = motion.pressures_of(found)
        answers = [found.joint_effort(0), found.drive_effort(0), *([head, rod] if np.isfinite(head).all() else [])]
        return dict(zip(names, answers, strict=False))

    def _beyond(self, model: ArmModel, moved: Moved) -> FloatArray:
        segment = motion.on_motion(model, *moved, temperature=self.oil).design.segments[0]
        return beyond(self.model, segment).astype(float)


def handed_over(session: Session, terms: Sequence[Term]) -> ArmModel:
    """Hand over the model of a session with so many terms; no loop was run."""
    data = [{"role": r.role, "file": r.file, "sha256": r.sha256, "samples": len(r)} for r in session.recordings]
    created = datetime.now(UTC).isoformat(timespec="seconds")
    report = {"created": created, "software": {}, "data": data, "loop": {"verdict": "not_examined"}}
    return hand_over(session, (), final_model(session, Corrections(session.machine), terms)[1].model, report)


def compiled(folder: Path, *sources: str) -> ctypes.CDLL:
    """Compile C, without a warning, as a library, and load it."""
    run(["cc", *STRICT, "-fPIC", "-shared", "-o", f"{sources[0]}.so", *sources, "-lm"], folder)
    return ctypes.CDLL(str(folder / f"{sources[0]}.so"))


def c_functions(model: ArmModel, folder: Path) -> Ask:
    """Export and compile a model's C; return what asks its functions, with the model's memory where None is given."""
    export_model(model, "c", folder)
    name, array = identifier(model.machine.name), ctypes.c_double * len(model.joints)
    library = compiled(folder, f"{name}.c")
    memory = (ctypes.c_double * program_of(model).memory)()

    def ask(function: str, given: Sequence[Any], outputs: int) -> list[list[float]]:
        out = [array() for _ in range(outputs)]
        inputs = [memory if own is None else array(*own) if np.ndim(own) else ctypes.c_double(own) for own in given]
        getattr(library, f"{name}_{function}")(*inputs, *out, *([memory] if function == "init" else []))
        return [list(own) for own in out]

    return ask


def run(command: list[str], folder: Path) -> None:
    """Run a judge in ``folder``; its complaint is an AssertionError."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    if done.returncode != 0:
        raise AssertionError(f"{command[0]} says: {(done.stderr or done.stdout).strip()[:400]}")
