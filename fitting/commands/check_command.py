"""``hilfit check``: what may be wrong with recordings and a machine file, each with its cure."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from daq.console import print_json, progress_bar, reported
from daq.errors import InputError
from fitting.commands import Columns, Files


def register(app: typer.Typer) -> None:
    """Mount the command."""
    app.command("check")(reported(_check))


def _check(
    recordings: Annotated[
        Files, typer.Argument(help="Recordings; their role is the one they were recorded in, else train.")
    ] = None,
    machine: Annotated[Path, typer.Option("--machine", "-m", help="Machine file.")] = Path("machine.yaml"),
    train: Annotated[Files, typer.Option(help="Training recording; may be given several times.")] = None,
    validate: Annotated[Files, typer.Option(help="Recording of another motion.")] = None,
    unloaded: Annotated[Files, typer.Option(help="Recording with the rods unpinned.")] = None,
    repeat: Annotated[Files, typer.Option(help="The training motion once more.")] = None,
    operation: Annotated[Files, typer.Option(help="Whatever the machine did that day.")] = None,
    columns: Columns = None,
    resample: Annotated[
        bool,
        typer.Option("--resample", help="Bring recordings of another rate to the machine's before they are checked."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check recordings and machine file for mistakes; exit code 1 if there may be one."""
    from daq.machine.machine_file import load_machine
    from daq.recordings.column_map import load_map
    from fitting.checks.check import check_files
    from fitting.checks.reading import recorded_role

    roles = {"unloaded": unloaded, "train": train, "repeat": repeat, "validate": validate, "operation": operation}
    files = [(recorded_role(path), path) for path in recordings or ()]
    files += [(role, path) for role, paths in roles.items() for path in paths or ()]
    if not files:
        raise InputError("fitting.no_recording_to_check")
    described = load_machine(machine)
    named = None if columns is None else load_map(columns, described)
    with progress_bar("checking", show=sys.stderr.isatty() and not json) as bar:

        def progress(share: float, text: str) -> None:
            bar(share, 1.0, text)

        found = check_files(described, files, machine, columns=named, resample=resample, progress=progress)
    wrong = any(finding.severity == "mistake" for finding in found)
    if json:
        print_json({"machine": str(machine), "findings": [finding.to_json() for finding in found]})
    else:
        lines = (f"{'MISTAKE' if own.severity == 'mistake' else 'note'} [{own.code}] {own.line}" for own in found)
        print("\n".join(lines) or f"nothing was found to be wrong with {len(files)} recording(s)")
    if wrong:
        raise typer.Exit(1)
