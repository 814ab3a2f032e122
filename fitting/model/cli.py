"""Command line of a handed-over model: ``predict``, ``compare`` and ``model``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.console import print_json, reported, show_table, working
from fitting.model.export import export_model, format_names

if TYPE_CHECKING:
    from daq.recordings.recording import Recording
    from fitting.model.arm_model import ArmModel
    from fitting.model.prediction import Predicted

ModelPath = Annotated[Path, typer.Argument(help="model.json, or the folder of a report that holds it.")]
RecordingPath = Annotated[Path, typer.Argument(help="Recording of the arm.")]
Columns = Annotated[
    Path | None,
    typer.Option("--map", help="YAML file: which column of the recording is which channel (channel: column)."),
]
Resample = Annotated[bool, typer.Option("--resample", help="Bring a recording of another rate to the machine's.")]
Json = Annotated[bool, typer.Option("--json", help="For programs.")]


def register(app: typer.Typer) -> None:
    """Mount the commands."""
    app.command("predict")(reported(predict))
    app.command("compare")(reported(compare))
    group = typer.Typer(help="Look at a handed-over model, and export it.", no_args_is_help=True)
    group.command("show")(reported(show))
    group.command("export")(reported(export))
    group.command("schema")(reported(schema))
    app.add_typer(group, name="model")


def opened(model: Path, recording: Path, columns: Path | None, resample: bool) -> tuple[ArmModel, Recording]:
    """A model and a recording of its arm, by the options of the commands."""
    from fitting.model.codec import load_model
    from fitting.model.prediction import load_recording

    loaded = load_model(model)
    return loaded, load_recording(loaded, recording, columns=columns, resample=resample)


def predict(
    model: ModelPath,
    recording: RecordingPath,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Table to write: .csv or .parquet.")] = None,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Predict the efforts in a recording; residual and 95 % band."""
    from fitting.model.prediction import predict, write_predicted

    with working("predicting", show=not json):
        found = predict(*opened(model, recording, columns, resample))
    if output is not None:
        write_predicted(output, found)
    if json:
        print_json(_summary(found))
        return
    print_table(
        ("joint", "unit", "error", "RMS", "relative", "in the 95 % band"),
        [
            (name, own["unit"], *(_short(own[key]) for key in ("error", "rms", "relative", "coverage")))
            for name, own in _summary(found)["joints"].items()
        ],
    )
    for name, share in zip(found.joints, found.beyond.mean(axis=0).tolist(), strict=True):
        if share:
            print(f"note: {name} is beyond what was recorded in {share:.1%} of the rows; the band says nothing there")
    for line in found.left_out:
        print(f"note: {line}")


def compare(
    first: Annotated[Path, typer.Argument(help="model.json or folder of the first model.")],
    second: Annotated[Path, typer.Argument(help="model.json or folder of the second model.")],
    recording: RecordingPath,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Predict a recording by two models of one machine: which is better, and which parameters differ."""
    from dataclasses import asdict

    from fitting.model.codec import load_model
    from fitting.model.prediction import compare

    with working("comparing", show=not json):
        one, seen = opened(first, recording, columns, resample)
        found = compare(one, load_model(second), seen)
    summaries = [_summary(own) for own in (found.first, found.second)]
    if json:
        shifts = [asdict(shift) for shift in found.shifts]
        print_json({"first": summaries[0], "second": summaries[1], "overall": found.overall, "shifts": shifts})
        return
    keys = ("error", "rms", "relative", "coverage")
    print_table(
        ("joint", "unit", *(f"{word} {which}" for word in ("error", "RMS", "relative", "in band") for which in "AB")),
        [
            (name, own["unit"], *(_short(s["joints"][name][key]) for key in keys for s in summaries))
            for name, own in summaries[0]["joints"].items()
        ],
    )
    if found.overall["change_percent"] is not None:
        low, high = found.overall["ci95_percent"]
        change = found.overall["change_percent"]
        print(f"error of all joints from A to B: {change:+.1f} % (95 % interval {low:+.1f} % to {high:+.1f} %)")
    if found.shifts:
        print_table(
            ("parameter", "unit", "A", "B", "difference / std"),
            [(s.name, s.unit, f"{s.first:.5g}", f"{s.second:.5g}", f"{s.sigmas:+.1f}") for s in found.shifts],
        )


def show(model: ModelPath, json: Json = False) -> None:
    """What a model holds: its card (machine, data, ranges, errors, effects), and its parameters with deviations."""
    from fitting.model.codec import load_model, model_to_json
    from fitting.model.export.words import said_of

    loaded = load_model(model)
    content = model_to_json(loaded)
    if json:
        keys = ("schema", "provenance", "parameters", "terms", "corrections")
        print_json({"machine": loaded.machine.name} | {key: content[key] for key in keys})
        return
    for line in said_of(loaded, ()):
        print(line)
    print_table(
        ("parameter", "value", "std", "unit"),
        [
            (own["name"], f"{own['value']:.5g}", "-" if own["std"] is None else f"{own['std']:.2g}", own["unit"])
            for own in content["parameters"]
        ],
    )


def schema() -> None:
    """Print the JSON schema of model.json."""
    from fitting.model.codec import model_schema

    print_json(model_schema())


def export(
    model: ModelPath,
    to: Annotated[str, typer.Option("--to", help=f"Format: {', '.join(format_names())}.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File or folder to write.")],
    possible: Annotated[
        bool, typer.Option("--possible", help="Links nearest to the model's where no bodies can have its parameters.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a model for another program; what the format does not carry is said."""
    from fitting.model.codec import load_model

    with working(f"writing {to}", show=not json):
        done = export_model(load_model(model), to, output, possible=possible)
    if json:
        print_json({"format": to, "files": [str(path) for path in done.files], "left_out": list(done.left_out)})
        return
    for path in done.files:
        print(path)
    for line in done.left_out:
        print(f"note: not in this format: {line}")


def _summary(found: Predicted) -> dict[str, Any]:
    """A prediction in numbers, for programs; errors are filtered as a report's are."""
    joints = {}
    for number, (name, unit) in enumerate(zip(found.joints, found.units, strict=True)):
        coverage = float(found.coverage[number])
        joints[name] = {
            "unit": unit,
            "error": found.filtered["std"][number],
            **{key: found.filtered[key][number] for key in ("rms", "mean", "relative")},
            "coverage": coverage if coverage == coverage else None,  # not a number where nothing moves
        }
    return {"joints": joints, "left_out": list(found.left_out)}


def _short(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def print_table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Print a table for people."""
    from rich.table import Table

    table = Table(*header, box=None)
    for row in rows:
        table.add_row(*row)
    show_table(table)
