"""The acquisition commands: ``record``, ``recover``, ``export``, ``import``; those about machine files."""

from __future__ import annotations

import time
from dataclasses import asdict
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.commands import cli_bus, cli_machine
from daq.console import Force, Json, MachineFile, may_be_written, print_json, progress_bar, reported, working
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording_files import SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from daq.acquisition.acquisition import AcquisitionProcess
    from daq.acquisition.recorder import RecordingSummary

Required = Annotated[
    list[str] | None,
    typer.Option("--require", metavar="CHANNEL", help="Only this channel (several times) has to be there."),
]
Trace = Annotated[
    Path | None, typer.Option("--trace", help="Also write every CAN frame: .blf, .asc or .log, a file per bus.")
]

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
    app.command()(reported(replay))
    app.command()(reported(recover))
    app.command()(reported(export))
    app.command("import")(reported(import_recording))
    cli_machine.register(app)
    cli_bus.register(app)


def record(
    machine: MachineFile,
    role: Annotated[Role, typer.Option(help="What the recording is for.")],
    seconds: Annotated[float, typer.Option(help="Length in seconds of machine time.", min=0.02)],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .parquet or .csv.")],
    wait: Annotated[
        float, typer.Option(help="Seconds that pass before: the controller moves to the motion's beginning.", min=0.0)
    ] = 0.0,
    require: Required = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Begin with what is there; the rest is taken in when it comes.")
    ] = False,
    trace: Trace = None,
    data_dir: cli_bus.DataDirectory = cli_bus.DATA_DIRECTORY,
    restore: Annotated[
        bool, typer.Option("--restore", help="At the end put CANopen nodes back to what they were.")
    ] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Acquire from the machine's buses and record."""
    from daq.acquisition.acquisition import AcquisitionProcess
    from daq.acquisition.recorder import Recorder

    _writable(output, force)
    described = load_machine(machine)
    if trace is not None:
        from daq.acquisition.trace import check_trace

        check_trace(trace)
    with (
        AcquisitionProcess(
            described,
            strict=not (allow_missing or require),
            required=require or (),
            data_directory=data_dir,
            trace=trace,
        ) as acquisition,
        progress_bar(f"recording {output.name}", show=not json) as bar,
    ):
        recorder = Recorder(acquisition.ring_name, described, role.value, output, overwrite=force)
        _let_pass(acquisition, wait * described.rate_hz)
        recorder.start(seconds, bar)
        interrupted = False
        try:
            summary = recorder.wait()
        except KeyboardInterrupt:  # what has come until now is worth keeping
            summary, interrupted = recorder.stop(), True
        statistics = acquisition.statistics()
    restored = _restored(described, data_dir) if restore else []
    if json:
        print_json({"recording": asdict(summary), "acquisition": asdict(statistics), "restored": restored})
    else:
        failures = [result["failure"] for result in restored if result["failure"]]
        _print_summary(described, summary, (*statistics.warnings, *summary.warnings, *failures))
        if interrupted:
            print(f"interrupted before {seconds:g} s were over")
    if interrupted:
        raise typer.Exit(INTERRUPTED)


def _print_summary(machine: Machine, summary: RecordingSummary, warnings: Sequence[str]) -> None:
    bad = sum(count for counts in summary.quality.values() for name, count in counts.items() if name != "held")
    print(
        f"{summary.path}: {summary.rows} rows, {summary.seconds:g} s at {machine.rate_hz:g} Hz, "
        f"{summary.missed_cycles} cycles missed, {bad} values not fresh"
    )
    for event in summary.events:
        print(_line(event))
    for warning in warnings:
        print(f"warning: {warning}")


def _let_pass(acquisition: AcquisitionProcess, cycles: float) -> None:
    """Wait until the ring has so many rows more; machine time, which need not be that of the wall.

    Raises
    ------
    HilfitError
        If acquisition ends meanwhile.
    """
    from daq.acquisition.ring import RingReader

    with RingReader(acquisition.ring_name) as reader:
        begin = reader.written
        while reader.written < begin + cycles:
            acquisition.check()
            time.sleep(0.01)


def _restored(machine: Machine, data_directory: Path) -> list[dict[str, Any]]:
    from daq.drivers.canopen.commissioning import restore_nodes

    return [asdict(result) for result in restore_nodes(machine, data_directory)]


def _line(event: dict[str, Any]) -> str:
    """Word an event as a line."""
    at = datetime.fromtimestamp(event["utc_ns"] / 1e9, UTC).strftime("%H:%M:%S.%f")[:-4]
    lasted = "lasts on" if event["seconds"] is None else f"{event['seconds']:.2f} s" if event["seconds"] else ""
    times = f"{event['count']} times" if event["count"] > 1 else ""
    more = ", ".join(part for part in (lasted, times) if part)
    return f"{at} UTC {event['device']}: {event['what']}{f' ({more})' if more else ''}: {event['text']}"


def _writable(output: Path, force: bool, suffixes: tuple[str, ...] = SUFFIXES) -> None:
    if output.suffix.lower() not in suffixes:
        raise InputError(
            "daq.unknown_kind_of_file", target=output, suffix=output.suffix, suffixes=" or ".join(suffixes)
        )
    may_be_written(output, force)


def replay(
    trace: Annotated[Path, typer.Argument(help="A raw trace, by the name that was given to record --trace.")],
    machine: Annotated[Path, typer.Option("--machine", help="The machine file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .parquet or .csv.")],
    role: Annotated[Role, typer.Option(help="What the recording is for.")] = Role.operation,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a recording from a raw trace, by the same drivers, without the machine."""
    from numpy import concatenate

    from daq.acquisition.recorder import rows_table
    from daq.acquisition.replay import replay as run
    from daq.frames.frame import row_from_frame
    from daq.recordings.recording_files import write_table

    _writable(output, force)
    described = load_machine(machine)
    with working(f"replaying {trace.name}", show=not json):
        result = run(described, trace)
    if not result.frames:
        raise InputError("daq.trace_without_cycles", trace=trace, machine=described.name)
    rows = concatenate([row_from_frame(frame) for frame in result.frames])
    write_table(output, rows_table(described, role.value, rows, rows["time"]))
    if json:
        print_json({"file": str(output), "rows": len(result.frames), "buses": result.buses, "events": result.events})
        return
    print(f"{output}: {len(result.frames)} rows from {trace}")
    for event in result.events:
        print(_line(event))


def recover(
    directory: Annotated[Path, typer.Argument(help="Where recordings are written to.")] = Path(),
    json: Json = False,
) -> None:
    """Seal what a killed recorder left behind; nothing is deleted, what cannot be read is named and left."""
    from daq.acquisition.journal import DONE_SUFFIX
    from daq.acquisition.journal import recover as seal

    with working("sealing", show=not json):
        results = seal(directory)
    if json:
        print_json([asdict(result) for result in results])
        return
    for result in results:
        if result.left:
            print(f"{result.journal}: left as it is: {result.left}")
            continue
        damaged = f", {result.damaged} damaged batches left out" if result.damaged else ""
        what = f"{result.rows} rows to {result.file}{damaged}" if result.file else "holds no rows"
        print(f"{result.journal}: {what}; kept as {result.journal.name}{DONE_SUFFIX}")
    if not results:
        print(f"{directory}: nothing to recover")


def export(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="File to write: .parquet, .csv, .mf4 (MDF4), .mcap or .mat.")
    ],
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a recording in another format."""
    from daq.recordings import recording_exports
    from daq.recordings.recording_files import read_table

    _writable(output, force, recording_exports.SUFFIXES)
    with working(f"writing {output.name}", show=not json):
        table = read_table(file)
        recording_exports.export(table, output, table.units)
    if json:
        print_json({"file": str(output), "rows": table.rows, "columns": list(table.columns)})
    else:
        print(f"{output}: {table.rows} rows, {len(table.columns)} columns")


def import_recording(
    file: Annotated[Path, typer.Argument(help="What another tool recorded: CSV, Parquet, MDF4, MAT, a ROS 2 bag.")],
    machine: Annotated[Path, typer.Option("--machine", help="The machine file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write: .parquet or .csv.")],
    columns: Annotated[
        Path | None, typer.Option("--map", help="YAML file: which column is which channel (channel: column).")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Bring another rate to the machine's with a zero-phase low pass.")
    ] = False,
    role: Annotated[Role | None, typer.Option(help="What the recording is for.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a recording of another tool's file: the machine's channels in their units, time in seconds."""
    from daq.recordings.column_map import load_map
    from daq.recordings.map_draft import UnknownColumnsError, write_draft
    from daq.recordings.recording_source import import_file

    _writable(output, force)
    described = load_machine(machine)
    named = None if columns is None else load_map(columns, described)
    try:
        with working(f"reading {file.name}", show=not json):
            rows, notes = import_file(
                file, described, output, named, resampled=resample, role=None if role is None else role.value
            )
    except UnknownColumnsError as error:
        raise InputError("daq.draft_of_map_written", error=error, draft=write_draft(error, described)) from None
    if json:
        print_json({"file": str(output), "rows": rows, "notes": list(notes)})
        return
    print(f"{output}: {rows} rows, {len(described.channels)} channels of '{described.name}'")
    for note in notes:
        print(f"note: {note}")
