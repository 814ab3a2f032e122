"""The acquisition commands: ``record``, ``recover``, ``export``, ``machine check``, ``machine schema``."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.console import print_json, progress_bar, reported
from daq.errors import InputError
from daq.machine_file import Machine, load_machine
from daq.recording_files import SUFFIXES

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
MachineFile = Annotated[Path, typer.Argument(help="The machine file.", metavar="MACHINE")]

INTERRUPTED = 130  # exit code: stopped by Ctrl-C, what was recorded is there


class Role(StrEnum):
    """Roles of a recording."""

    unloaded = "unloaded"
    train = "train"
    repeat = "repeat"
    validate = "validate"
    operation = "operation"


def register(app: typer.Typer) -> None:
    """Add the acquisition commands to ``app``."""
    app.command()(reported(record))
    app.command()(reported(recover))
    app.command()(reported(export))
    machine = typer.Typer(help="Look at machine files.", no_args_is_help=True)
    machine.command("check")(reported(check))
    machine.command("schema")(reported(schema))
    app.add_typer(machine, name="machine")


def record(
    machine: MachineFile,
    role: Annotated[Role, typer.Option(help="What the recording is for.")],
    seconds: Annotated[float, typer.Option(help="Length in seconds of machine time.", min=0.02)],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .parquet or .csv.")],
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
    json: Json = False,
) -> None:
    """Acquire from the machine's buses and record."""
    from daq.acquisition import AcquisitionProcess
    from daq.recorder import Recorder

    _writable(output, force)
    described = load_machine(machine)
    with (
        AcquisitionProcess(described) as acquisition,
        progress_bar(f"recording {output.name}", show=not json) as bar,
    ):
        recorder = Recorder(acquisition.ring_name, described, role.value, output, overwrite=force)
        recorder.start(seconds, bar)
        interrupted = False
        try:
            summary = recorder.wait()
        except KeyboardInterrupt:  # what has come until now is worth keeping
            summary, interrupted = recorder.stop(), True
        statistics = acquisition.statistics()
    if json:
        print_json({"recording": asdict(summary), "acquisition": asdict(statistics)})
        raise typer.Exit(INTERRUPTED if interrupted else 0)
    bad = sum(sum(counts.values()) for counts in summary.quality.values())
    print(
        f"{summary.path}: {summary.rows} rows, {summary.seconds:g} s at {described.rate_hz:g} Hz, "
        f"{summary.missed_cycles} cycles missed, {bad} values not fresh"
    )
    for warning in statistics.warnings:
        print(f"warning: {warning}")
    if interrupted:
        print(f"interrupted before {seconds:g} s were over")
        raise typer.Exit(INTERRUPTED)


def _writable(output: Path, force: bool) -> None:
    if output.suffix.lower() not in SUFFIXES:
        raise InputError(f"{output}: unknown kind of file '{output.suffix}'; use {' or '.join(SUFFIXES)}")
    if output.exists() and not force:
        raise InputError(f"{output}: is there already; choose another name, or add --force")


def recover(
    directory: Annotated[Path, typer.Argument(help="Where recordings are written to.")] = Path(),
    json: Json = False,
) -> None:
    """Seal what a killed recorder left behind."""
    from daq.journal import recover as seal

    results = seal(directory)
    if json:
        print_json([asdict(result) for result in results])
        return
    for result in results:
        print(f"{result.journal}: " + (f"{result.rows} rows to {result.file}" if result.file else "empty, removed"))
    if not results:
        print(f"{directory}: nothing to recover")


def export(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .parquet or .csv.")],
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
    json: Json = False,
) -> None:
    """Write a recording in another format."""
    from daq.recording_files import read_table, write_columns

    _writable(output, force)
    table = read_table(file)
    write_columns(output, table)
    if json:
        print_json({"file": str(output), "rows": table.rows, "columns": list(table.columns)})
    else:
        print(f"{output}: {table.rows} rows, {len(table.columns)} columns")


def check(
    file: Annotated[Path, typer.Argument(help="The machine file.")],
    json: Json = False,
) -> None:
    """Say what is wrong with a machine file, with line and key; or what it describes."""
    machine = load_machine(file)
    facts = _facts(machine)
    if json:
        print_json(facts)
        return
    print(f"{file}: a valid machine file ({machine.schema_})")
    for key, value in facts.items():
        print(f"  {key}: {value}")


def _facts(machine: Machine) -> dict[str, Any]:
    return {
        "name": machine.name,
        "rate_hz": machine.rate_hz,
        "joints": len(machine.joints),
        "cylinders": sum(joint.cylinder is not None for joint in machine.joints),
        "channels": len(machine.channels),
        "buses": [f"{bus.name} ({bus.type})" for bus in machine.buses],
        "can_be_acquired": bool(machine.buses) and all(channel.source for channel in machine.channels),
    }


def schema() -> None:
    """Print the JSON schema of machine files, for editors."""
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **Machine.model_json_schema()})
