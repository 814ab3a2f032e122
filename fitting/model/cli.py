"""Command line of a handed-over model: what it predicts, what it is used for, and its export."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from daq.console import print_json, reported, show_table, working
from daq.errors import InputError
from fitting.model.export import export_model, format_names

if TYPE_CHECKING:
    from daq.recordings.recording import Recording
    from fitting.model.arm_model import ArmModel
    from fitting.model.prediction import Predicted
    from fitting.model.uses.energy import Energy

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
    app.command("predict")(reported(_predict))
    app.command("compare")(reported(_compare))
    app.command("feedforward")(reported(_feedforward))
    app.command("energy")(reported(_energy))
    app.command("overload")(reported(_overload))
    app.command("payload")(reported(_payload))
    group = typer.Typer(help="Look at a handed-over model, and export it.", no_args_is_help=True)
    group.command("show")(reported(_show))
    group.command("export")(reported(export))
    group.command("schema")(reported(_schema))
    app.add_typer(group, name="model")


def _opened(model: Path, recording: Path, columns: Path | None, resample: bool) -> tuple[ArmModel, Recording]:
    """Open a model and a recording of its arm, by the commands' options."""
    from fitting.model.codec import load_model
    from fitting.model.prediction import load_recording

    loaded = load_model(model)
    return loaded, load_recording(loaded, recording, columns=columns, resample=resample)


def _predict(
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
        found = predict(*_opened(model, recording, columns, resample))
    if output is not None:
        write_predicted(output, found)
    if json:
        print_json(_summary(found))
        return
    _print_table(
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


def _compare(
    first: Annotated[Path, typer.Argument(help="model.json or folder of the first model.")],
    second: Annotated[Path, typer.Argument(help="model.json or folder of the second model.")],
    recording: RecordingPath,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Predict a recording by two models of one machine: which is better, and which parameters differ."""
    from fitting.model.codec import load_model
    from fitting.model.prediction import compare

    with working("comparing", show=not json):
        one, seen = _opened(first, recording, columns, resample)
        found = compare(one, load_model(second), seen)
    summaries = [_summary(own) for own in (found.first, found.second)]
    if json:
        shifts = [asdict(shift) for shift in found.shifts]
        print_json({"first": summaries[0], "second": summaries[1], "overall": found.overall, "shifts": shifts})
        return
    keys = ("error", "rms", "relative", "coverage")
    _print_table(
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
        _print_table(
            ("parameter", "unit", "A", "B", "difference / std"),
            [(s.name, s.unit, f"{s.first:.5g}", f"{s.second:.5g}", f"{s.sigmas:+.1f}") for s in found.shifts],
        )


def _show(model: ModelPath, json: Json = False) -> None:
    """Show a model: its card (machine, data, ranges, errors, effects), and its parameters with deviations."""
    from fitting.model.codec import load_model, model_to_json
    from fitting.model.export.words import model_card

    loaded = load_model(model)
    content = model_to_json(loaded)
    if json:
        keys = ("schema", "provenance", "parameters", "terms", "corrections")
        print_json({"machine": loaded.machine.name} | {key: content[key] for key in keys})
        return
    for line in model_card(loaded, ()):
        print(line)
    _print_table(
        ("parameter", "value", "std", "unit"),
        [
            (own["name"], f"{own['value']:.5g}", "-" if own["std"] is None else f"{own['std']:.2g}", own["unit"])
            for own in content["parameters"]
        ],
    )


def _schema() -> None:
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
    """Write a model for another program; what the format does not carry is reported."""
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
    """Return a prediction in numbers, for programs; errors filtered as in reports."""
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


def _print_table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Print a table for people."""
    from rich.table import Table

    table = Table(*header, box=None)
    for row in rows:
        table.add_row(*row)
    show_table(table)


Temperature = Annotated[float | None, typer.Option(help="Temperature of the oil, K, for laws of it.", min=0.0)]
Table = Annotated[Path | None, typer.Option("--output", "-o", help="Table to write: .csv or .parquet.")]


def _feedforward(
    model: ModelPath,
    motion: Annotated[Path, typer.Argument(help="Motion file, as 'hilfit excite' writes it.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Table to write: .csv or .parquet.")],
    rod_pressure: Annotated[
        float | None, typer.Option(help="Rod pressure that the machine keeps, Pa; as recorded if absent.", min=0.0)
    ] = None,
    temperature: Temperature = None,
    json: Json = False,
) -> None:
    """Write the efforts and pressures that a motion takes, for the arm's controller to add."""
    from fitting.model.codec import load_model
    from fitting.model.uses.feedforward import feedforward, read_path, write_feedforward

    loaded = load_model(model)
    found = feedforward(loaded, read_path(loaded, motion), rod_pressure, temperature=temperature)
    write_feedforward(output, found)
    largest = {name: float(abs(found.effort[:, k]).max()) for k, name in enumerate(found.joints)}
    if json:
        print_json({"file": str(output), "rows": len(found.path.t), "largest": largest, "left_out": found.left_out})
        return
    print(output)
    for name, unit in zip(found.joints, found.units, strict=True):
        print(f"{name}: at most {largest[name]:.4g} {unit}")
    for line in found.left_out:
        print(f"note: not in it: {line}")


def _energy(
    model: ModelPath,
    motion: Annotated[Path, typer.Argument(help="Motion file, or a recording.")],
    temperature: Temperature = None,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Compute the work of the drives in a motion: input, return, friction."""
    from daq.motion_files import SCHEMA
    from fitting.model.codec import load_model
    from fitting.model.uses.energy import energy_of_motion, energy_of_recording
    from fitting.model.uses.feedforward import read_path

    if _begins(motion, f"# {SCHEMA}"):
        loaded = load_model(model)
        found = energy_of_motion(loaded, read_path(loaded, motion), temperature)
    else:
        found = energy_of_recording(*_opened(model, motion, columns, resample))
    rows = _energy_rows(found)
    if json:
        print_json({"seconds": found.seconds, "joints": rows})
        return
    keys = [key for key, value in next(iter(rows.values())).items() if value is not None]
    print(f"work in {found.seconds:.1f} s, J")
    _print_table(("joint", *keys), [(name, *(f"{own[key]:.4g}" for key in keys)) for name, own in rows.items()])


def _begins(path: Path, text: str) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(text)) == text.encode()
    except OSError as error:
        raise InputError("fitting.cannot_read_motion_recording", path=path, reason=error.strerror) from None


def _energy_rows(found: Energy) -> dict[str, dict[str, float | None]]:
    rows: dict[str, dict[str, float | None]] = {}
    for k, name in enumerate(found.joints):
        rows[name] = {key: float(getattr(found, key)[k]) for key in ("given", "given_std", "returned", "friction")}
        rows[name]["measured"] = None if found.measured is None else float(found.measured[k])
    return rows


def _overload(
    model: ModelPath,
    recording: RecordingPath,
    usual: Annotated[
        list[Path] | None,
        typer.Option(help="Recording of the unchanged machine to learn from, instead of the model's own; repeatable."),
    ] = None,
    false_alarms: Annotated[
        float, typer.Option(help="False alarms an hour that the threshold is made for.", min=1e-6)
    ] = 1.0,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Find collisions and overloads in a recording: the residual against its band, sample by sample."""
    from fitting.model.uses.overload import delay_s, learn, overloads, quick, thresholds

    loaded, seen = _opened(model, recording, columns, resample)
    before = [_opened(model, path, columns, resample)[1] for path in usual or ()]
    tails = learn(loaded, before) if usual else loaded.tails
    if tails is None:
        raise InputError("fitting.model_without_usual", model=model)
    limits = thresholds(tails, false_alarms)
    found = overloads(loaded, seen, limits)
    late = delay_s(quick(loaded))
    if json:
        alarms = [asdict(own) | {"joint": loaded.joints[own.joint]} for own in found]
        print_json(
            {"delay_s": late, "thresholds": dict(zip(loaded.joints, limits.tolist(), strict=True)), "alarms": alarms}
        )
        return
    print(f"{len(found)} alarms; {false_alarms:g} false ones an hour are expected; known {1e3 * late:.0f} ms later")
    units = loaded.joint_units
    _print_table(
        ("time in s", "joint", "residual", "threshold there", "unit", "score", "threshold"),
        [
            (
                *(f"{o.found:.2f}", loaded.joints[o.joint], f"{o.residual:.4g}", f"{o.limit:.4g}"),
                *(units[o.joint], f"{o.score:.1f}", f"{o.threshold:.1f}"),
            )
            for o in found
        ],
    )


def _payload(
    model: ModelPath,
    recording: RecordingPath,
    output: Table = None,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Estimate the mass at the tip over a recording, beyond what was there in the fit's recordings."""
    import numpy as np
    import pyarrow as pa

    from daq.recordings.recording_files import write_table
    from fitting.model.uses.payload import payload_signal

    found = payload_signal(*_opened(model, recording, columns, resample))
    if output is not None:
        write_table(output, pa.table({"time": found.t, "payload.mass": found.mass, "payload.std": found.std}))
    known = np.isfinite(found.mass)
    if json:
        signals = {"time": found.t, "mass": found.mass, "std": found.std}
        print_json({name: own[known].tolist() for name, own in signals.items()})
        return
    if not known.any():
        print("nothing moves for long enough")
        return
    every = max(1, len(found.t) // 12)
    _print_table(
        ("time in s", "mass in kg", "std"),
        [
            (f"{t:.1f}", "-", "-") if m != m else (f"{t:.1f}", f"{m:+.2f}", f"{s:.2f}")
            for t, m, s in list(zip(found.t, found.mass, found.std, strict=True))[::every]
        ],
    )
