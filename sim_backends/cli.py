"""``hilfit simulate``: simulated buses as processes of their own, until interrupted."""

from __future__ import annotations

import signal
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.console import print_json, reported
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine
from daq.whole_files import write_whole

if TYPE_CHECKING:
    from sim_backends.faults.fault_file import FaultScript
    from sim_backends.simulated_machine import SimulatedMachine


def register(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command("simulate")(reported(simulate))


def checked_faults(path: Path, machine: Machine) -> FaultScript:
    """Check a fault file for this machine; write every mistake in it as a line on standard error.

    Raises
    ------
    InputError
        With the last of those lines.
    """
    from sim_backends.faults.fault_file import read_faults

    script, problems = read_faults(path, machine)
    if script is None:
        for line in problems[:-1]:
            typer.echo(f"hilfit: {line}", err=True)
        raise InputError(problems[-1])
    return script


def simulate(
    machine: Annotated[Path, typer.Argument(help="Machine file with buses and sources.")],
    undeclared: Annotated[
        list[str] | None,
        typer.Option(
            help="EFFECT:JOINT:SIZE that the plant has and the machine file does not say; repeatable. Of "
            "simulated valves EFFECT:FORM:JOINT:SIZE."
        ),
    ] = None,
    truth: Annotated[Path | None, typer.Option(help="The plant's own parameters (YAML).")] = None,
    guess_truth: Annotated[
        Path | None,
        typer.Option(help="Write plant parameters to begin with to this file (links as steel boxes), and end."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything random.", min=0)] = 0,
    speed: Annotated[float, typer.Option(help="Machine seconds per second, up to 4.")] = 1.0,
    faults: Annotated[Path | None, typer.Option(help="Fault file (YAML): what breaks when, and for how long.")] = None,
    motion: Annotated[list[Path] | None, typer.Option(help="Motion files to follow at once; repeatable.")] = None,
    workdir: Annotated[Path | None, typer.Option(help="Where machine.yaml and the inbox go.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print where things are as JSON, on standard output.")] = False,
) -> None:
    """Run simulated buses of MACHINE until interrupted; prints the machine file to acquire with."""
    # The physics engine is an extra, and other commands need not load it.
    from sim_backends.simulated_machine import SimulatedMachine, truth_of

    declared = load_machine(machine)
    if guess_truth is not None:
        _write_guess(guess_truth, declared, seed, json)
        return
    true = truth_of(declared, truth)
    specs = _hidden(true, undeclared or [], motion or [], declared)
    script = None if faults is None else checked_faults(faults, declared)
    if workdir is not None and workdir.exists() and not workdir.is_dir():
        raise InputError("sim_backends.workdir_no_directory", workdir=workdir)
    ended = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with tempfile.TemporaryDirectory(prefix="hilfit-") as scratch:
        simulated = SimulatedMachine(
            declared,
            true,
            specs,
            seed,
            speed,
            workdir or Path(scratch),
            faults=script,
            show=lambda text: typer.echo(text, err=json),
        )
        with simulated:
            for path in motion or []:
                write_whole(simulated.inbox / path.name, path.read_bytes())
            _show_where(simulated, json)
            while not ended.wait(1.0):
                simulated.check()


def _hidden(true: Any, undeclared: Sequence[str], motions: Sequence[Path], machine: Machine) -> list[Any]:
    """Parse effects of the command line for the kind of plant; read motion files once, to refuse them here."""
    from sim_backends.plant.motion import read_motion
    from sim_backends.undeclared import parse_spec
    from sim_backends.valve.effects import parse_valve_spec
    from sim_backends.valve.truth import ValvePlantTruth
    from sim_backends.valve.valve_process import read_any_motion

    valves = isinstance(true, ValvePlantTruth)
    specs = [parse_valve_spec(text) if valves else parse_spec(text, machine) for text in undeclared]
    for path in motions:
        (read_any_motion if valves else read_motion)(path, machine)
    return specs


def _write_guess(path: Path, machine: Machine, seed: int, json: bool) -> None:
    """Write a guess of the plant's parameters to a file, never over one that is there."""
    from sim_backends.plant.guessed_truth import guessed_truth_yaml

    text = guessed_truth_yaml(machine, seed)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError("sim_backends.guess_there_already", path=path) from None
    except OSError as error:
        raise InputError("sim_backends.guess_not_writable", path=path, reason=error.strerror) from None
    if json:
        print_json({"truth": str(path)})
    else:
        typer.echo(f"{path}: a guess, change it at will; simulate with: --truth {path}")


def _show_where(simulated: SimulatedMachine, json: bool) -> None:
    """Print where the files are by which others meet the simulated machine."""
    if json:
        places = {"machine": simulated.machine_path, "inbox": simulated.inbox, "controller": simulated.status_path}
        print_json({name: str(path) for name, path in places.items()})
        sys.stdout.flush()
        return
    typer.echo(f"machine file  {simulated.machine_path}")
    typer.echo(f"motion inbox  {simulated.inbox}")
    typer.echo(f"controller    {simulated.status_path}")
    typer.echo("Machine time advances with each SYNC. Ctrl-C ends it.")
