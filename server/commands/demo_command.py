"""``hilfit demo``: the whole main job on simulated buses, from transducers to a corrected model and its report.

The simulated machine runs as processes of its own and is talked to like any machine: motions are handed to its
controller as files, signals come over CANopen and Modbus through the ordinary drivers. What its plant has that the
model lacks is known to the plant alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.console import print_json, progress_bar, reported
from daq.errors import InputError
from daq.messages import Sentence
from daq.motion_files import LONGEST_S
from fitting.commands.identify_command import Spoken

if TYPE_CHECKING:
    from daq.acquisition.acquisition import AcquisitionProcess
    from daq.acquisition.recorder import RecordingSummary
    from daq.machine.machine_file import Machine
    from daq.motion_files import Motion
    from daq.recordings.recording import Recording
    from fitting.loop.closing import Asked
    from sim_backends.simulated_machine import SimulatedMachine

Progress = Callable[[float, str], None]

#: Motions in the order they are recorded: file name, role, and the designed motion that it is.
PLAN = (
    ("unloaded", "unloaded", "unloaded"),
    ("train-1", "train", "train-1"),
    ("train-2", "train", "train-2"),
    ("repeat", "repeat", "train-1"),
    ("validate", "validate", "validate"),
)
#: What each of them leaves.
_OF_A_MOTION = ("motions/{}.csv", "machine/inbox/{}.csv", "recordings/{}.parquet", "recordings/{}.parquet.journal")
#: Share of the progress bar that each part takes.
_DESIGN, _RECORD = 0.12, 0.7


@dataclass(frozen=True)
class Acquired:
    """Result of acquisition: recorded files with their roles, and its counts."""

    recordings: tuple[tuple[str, Path], ...]
    rate_hz: float
    rows: int
    missed_cycles: int
    not_fresh: int

    @classmethod
    def of(cls, recorded: Sequence[tuple[str, Path, RecordingSummary]], rate_hz: float) -> Acquired:
        """Collect what was recorded: role, file, and the recorder's counts of each."""
        counts = [summary for _, _, summary in recorded]
        not_fresh = sum(sum(own.values()) for summary in counts for own in summary.quality.values())
        files = tuple((role, path) for role, path, _ in recorded)
        return cls(files, rate_hz, sum(own.rows for own in counts), sum(own.missed_cycles for own in counts), not_fresh)

    def text(self, started: float) -> str:
        """Describe it in a line, with the time since ``started`` (:func:`time.monotonic`)."""
        return (
            f"acquired {self.rows} cycles of {1000 / self.rate_hz:g} ms machine time ({self.rate_hz:.1f} Hz), "
            f"{self.missed_cycles} missing, {self.not_fresh} values not fresh; "
            f"{time.monotonic() - started:.0f} s in all"
        )


def register(app: typer.Typer) -> None:
    """Mount the command."""
    app.command("demo")(reported(demo))


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory of everything it makes.")] = Path(
        "hilfit-demo"
    ),
    undeclared: Annotated[
        list[str] | None,
        typer.Option(help="EFFECT:JOINT:SIZE that the plant has and the model lacks; 'none' for a perfect plant."),
    ] = None,
    seconds: Annotated[
        float, typer.Option(help="Length of each recording in machine time.", min=20.0, max=LONGEST_S)
    ] = 40.0,
    speed: Annotated[float, typer.Option(help="Machine seconds per second, at most 4.", min=0.1)] = 4.0,
    seed: Annotated[int, typer.Option(help="Of the plant's noise and of the designed motions.", min=0)] = 1,
    faults: Annotated[Path | None, typer.Option(help="Fault file (YAML): what breaks when, and for how long.")] = None,
    resolve: Annotated[
        bool,
        typer.Option("--resolve", help="Record the designed motion where names cannot be told apart; two at most."),
    ] = False,
    language: Spoken = "en",
    valve: Annotated[
        bool, typer.Option("--valve", help="Of a crane's valves instead; --undeclared is EFFECT:FORM:JOINT:SIZE.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print report.json on standard output.")] = False,
) -> None:
    """Simulate an arm with an effect nobody declared, record it over its buses, identify it, and find the effect."""
    started = time.monotonic()
    if valve and (faults is not None or resolve or language != "en"):
        raise InputError("server.valve_demo_options")
    tests: list[str] = []
    with progress_bar("demo", show=not json) as bar:

        def progress(share: float, text: str) -> None:
            bar(share, 1.0, text)

        if valve:
            from server.commands.valve_demo import run_valve_demo

            report, acquired, tests = run_valve_demo(output, undeclared, seconds, speed, seed, progress)
        else:
            report, acquired = run_demo(
                output, undeclared, seconds=seconds, speed=speed, seed=seed, faults=faults, resolve=resolve,
                language=language, progress=progress,
            )  # fmt: skip
    if json:
        print_json(report)
        return
    print(acquired.text(started))
    if valve:
        _print_valves(report, tests, output)
        return
    from fitting.pipeline.results.summary import print_summary

    print_summary(report, output)
    if resolve:
        print(_asked_of_the_machine(report["loop"]))


def _print_valves(report: Mapping[str, Any], tests: Sequence[str], output: Path) -> None:
    from fitting.commands.valve_command import print_valves

    print_valves(report)
    print("\n".join([*tests, f"report: {output / 'valve.json'}"]))


def _asked_of_the_machine(loop: Mapping[str, Any]) -> str:
    """Describe what ``--resolve`` achieved, in a line."""
    made, hypotheses = len(loop["resolution"]), loop["hypotheses"]
    motions = {0: "no motion was", 1: "one motion was"}.get(made, f"{made} motions were") + " recorded to resolve it"
    if not loop["effects"] and not loop["unexplained"]:
        return "nothing is ambiguous: nothing was found"
    if hypotheses and hypotheses[0]["probability"] >= 0.95:
        return f"one explanation has 95 %: {motions}"
    why = (loop["next_experiment"] or {}).get("why", "no motion tells what is left apart")
    return f"it stays ambiguous: {motions}; {why}"


def run_demo(
    output: Path,
    undeclared: Sequence[str] | None = None,
    *,
    seconds: float = 40.0,
    speed: float = 4.0,
    seed: int = 1,
    faults: Path | None = None,
    resolve: bool = False,
    language: str = "en",
    progress: Progress = lambda share, text: None,
) -> tuple[dict[str, Any], Acquired]:
    """Run the demo; returns the report and what was acquired.

    Parameters
    ----------
    output : directory; gets ``motions/``, ``recordings/``, ``machine/`` (the simulated machine's files) and the report
    undeclared : ``EFFECT:JOINT:SIZE`` texts; None lets the plant choose its own, ``["none"]`` gives a perfect plant
    seconds : length of each recording in machine time
    speed : machine seconds per second
    seed : of the plant's noise and of the motions
    faults : a fault file, what breaks while the machine is recorded
    resolve : whether the machine makes the designed motion where the recordings leave more than one explanation
    language : of report.html
    progress : called with the share done and what is being done
    """
    from fitting.loop.session import Request
    from fitting.pipeline.resolving import identify_and_resolve
    from fitting.pipeline.stages import identify, require_writable
    from sim_backends.cli import checked_faults
    from sim_backends.machines import default_machine
    from sim_backends.simulated_machine import SimulatedMachine

    machine, _ = default_machine()
    script = None if faults is None else checked_faults(faults, machine)
    require_writable(output)
    effects = _effects(undeclared, machine)
    simulated = SimulatedMachine(machine, None, effects, seed, speed, output / "machine", faults=script)
    with alone_in(output):
        progress(0.0, "starting the simulated machine")
        with simulated:
            acquired = _acquired(simulated, output, seconds, seed, lambda s, t: progress(_RECORD * s, t))
            request = Request(output / "machine" / "machine.yaml", acquired.recordings, output, languages=(language,))

            def identifying(share: float, text: str) -> None:
                progress(_RECORD + (1 - _RECORD) * share, text)

            if resolve:
                return identify_and_resolve(request, partial(_record_asked, simulated, output), identifying), acquired
        return identify(request, identifying), acquired


@contextmanager
def alone_in(output: Path) -> Iterator[None]:
    """Reserve a folder for one demo, without what an earlier one left, by the names that demos use.

    So no old report is beside new recordings. A demo that was interrupted left a journal, which would be refused,
    and perhaps a motion for the arm's controller.
    """
    from fitting.model.codec import MODEL_FILE
    from fitting.pipeline.stage_names import NEXT_MOTION
    from server.platform.files import held

    output.mkdir(parents=True, exist_ok=True)
    taken = Sentence("server.demo_running", output=output)
    names = (*(name for name, _, _ in PLAN), "resolve-*", "valve-*")
    old = ["report.json", "report*.html", "valve.json", "inverse/valve_*", MODEL_FILE, NEXT_MOTION]
    old += [place.format(name) for name in names for place in _OF_A_MOTION]
    with held(output / ".lock", str(output), taken):
        for pattern in old:
            for path in output.glob(pattern):
                path.unlink()
        yield


def _acquired(simulated: SimulatedMachine, output: Path, seconds: float, seed: int, progress: Progress) -> Acquired:
    """Design the motions, and record them all."""
    from daq.acquisition.acquisition import AcquisitionProcess

    design = _DESIGN / _RECORD
    motions = _design_motions(simulated.machine_path, seconds, seed, lambda s, t: progress(design * s, t))
    for name, motion in motions.items():
        save_motion(output / "motions" / f"{name}.csv", motion)
    with AcquisitionProcess(simulated.machine_path) as acquisition:
        return _record_all(
            simulated,
            acquisition,
            motions,
            output / "recordings",
            lambda s, t: progress(design + (1 - design) * s, t),
        )


def _design_motions(machine_path: Path, seconds: float, seed: int, progress: Progress) -> dict[str, Motion]:
    """Design one signal for all free cylinders, two complementary training motions, one for validation."""
    from daq.machine.machine_file import load_machine
    from fitting.arm.base_parameters import reduce_parameters
    from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion
    from fitting.excitation.design import design_motion, design_sequence
    from fitting.excitation.problem import ExcitationOptions

    machine = load_machine(machine_path)
    base = reduce_parameters(machine)
    options = ExcitationOptions(seconds=seconds, starts=1, iterations=40)
    progress(0.0, "designing the free cylinders' signals")
    free = design_cylinder_motion(machine, seed=seed, options=CylinderOptions(seconds=seconds, starts=2)).motion
    progress(0.2, "designing the training motions")
    first, second = design_sequence(machine, base, 2, seed=seed, options=options)
    progress(0.75, "designing the validation motion")
    other = design_motion(machine, base, seed=seed + 1000, options=options)
    return {"unloaded": free, "train-1": first.motion, "train-2": second.motion, "validate": other.motion}


def _record_all(
    simulated: SimulatedMachine,
    acquisition: AcquisitionProcess,
    motions: dict[str, Motion],
    directory: Path,
    progress: Progress,
) -> Acquired:
    """Hand each motion to the arm's controller, record while it follows, and count what came."""
    recorded = []
    for number, (name, role, motion_name) in enumerate(PLAN):
        what = f"recording {name}"
        progress(number / len(PLAN), what)
        path = directory / f"{name}.parquet"

        def shown(done: int, total: int | None, number: int = number, what: str = what) -> None:
            progress((number + done / (total or 1)) / len(PLAN), what)

        summary = _record_motion(simulated, acquisition, motions[motion_name], (name, role), path, shown)
        recorded.append((role, path, summary))
    return Acquired.of(recorded, acquisition.machine.rate_hz)


def _record_motion(
    simulated: SimulatedMachine,
    acquisition: AcquisitionProcess,
    motion: Motion,
    called: tuple[str, str],
    path: Path,
    shown: Callable[[int, int | None], None] = lambda done, total: None,
) -> RecordingSummary:
    """Hand one motion, by its name and role, to the arm's controller, record while it follows, and wait for its end."""
    from daq.acquisition.recorder import Recorder

    name, role = called
    save_motion(simulated.inbox / f"{name}.csv", motion)
    simulated.wait_following(name)
    recorder = Recorder(acquisition.ring_name, acquisition.machine, role, path, overwrite=True)
    summary = recorder.record(motion.seconds, shown)
    acquisition.check()
    # The arm holds its last pose; the next motion starts from there.
    simulated.wait_done(name)
    return summary


def _record_asked(simulated: SimulatedMachine, output: Path, asked: Asked, number: int) -> Recording:
    """Let the arm make a motion that the identification needs (a :class:`fitting.loop.closing.Recorder`).

    Acquisition runs while it is recorded and not in between, so machine time is halted meanwhile.
    """
    from daq.acquisition.acquisition import AcquisitionProcess
    from daq.recordings.recording import read_recording

    name = f"resolve-{number}"
    save_motion(output / "motions" / f"{name}.csv", asked.motion)
    path = output / "recordings" / f"{name}.parquet"
    with AcquisitionProcess(simulated.machine_path) as acquisition:
        _record_motion(simulated, acquisition, asked.motion, (name, asked.role), path)
        machine = acquisition.machine
    return read_recording(path, machine, asked.role)


def _effects(texts: Sequence[str] | None, machine: Machine) -> Any:
    from sim_backends.undeclared import parse_spec

    if texts is None:
        return "demo"
    return [parse_spec(text, machine) for text in texts if text != "none"]


def save_motion(path: Path, motion: Motion) -> None:
    """Write a motion file, and the folder that it is in."""
    from daq.motion_files import write_motion

    path.parent.mkdir(parents=True, exist_ok=True)
    write_motion(path, motion)
