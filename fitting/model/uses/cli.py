"""Commands that use a model: ``feedforward``, ``energy``, ``overload`` and ``payload``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.console import print_json, reported
from daq.errors import InputError
from fitting.model.cli import Columns, Json, ModelPath, RecordingPath, Resample, opened, print_table

if TYPE_CHECKING:
    from fitting.model.uses.energy import Energy

Temperature = Annotated[float | None, typer.Option(help="Temperature of the oil, K, for laws of it.", min=0.0)]
Table = Annotated[Path | None, typer.Option("--output", "-o", help="Table to write: .csv or .parquet.")]


def register(app: typer.Typer) -> None:
    """Mount the commands."""
    for command in (feedforward, energy, overload, payload):
        app.command(command.__name__)(reported(command))


def feedforward(
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


def energy(
    model: ModelPath,
    motion: Annotated[Path, typer.Argument(help="Motion file, or a recording.")],
    temperature: Temperature = None,
    columns: Columns = None,
    resample: Resample = False,
    json: Json = False,
) -> None:
    """Work of the drives in a motion: put in, given back, taken by friction."""
    from daq.motion_files import SCHEMA
    from fitting.model.codec import load_model
    from fitting.model.uses.energy import energy_of_motion, energy_of_recording
    from fitting.model.uses.feedforward import read_path

    if _begins(motion, f"# {SCHEMA}"):
        loaded = load_model(model)
        found = energy_of_motion(loaded, read_path(loaded, motion), temperature)
    else:
        found = energy_of_recording(*opened(model, motion, columns, resample))
    rows = _energy_rows(found)
    if json:
        print_json({"seconds": found.seconds, "joints": rows})
        return
    keys = [key for key, value in next(iter(rows.values())).items() if value is not None]
    print(f"work in {found.seconds:.1f} s, J")
    print_table(("joint", *keys), [(name, *(f"{own[key]:.4g}" for key in keys)) for name, own in rows.items()])


def _begins(path: Path, text: str) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(text)) == text.encode()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a motion file or a recording") from None


def _energy_rows(found: Energy) -> dict[str, dict[str, float | None]]:
    rows: dict[str, dict[str, float | None]] = {}
    for k, name in enumerate(found.joints):
        rows[name] = {key: float(getattr(found, key)[k]) for key in ("given", "given_std", "returned", "friction")}
        rows[name]["measured"] = None if found.measured is None else float(found.measured[k])
    return rows


def overload(
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

    loaded, seen = opened(model, recording, columns, resample)
    before = [opened(model, path, columns, resample)[1] for path in usual or ()]
    tails = learn(loaded, before) if usual else loaded.tails
    if tails is None:
        raise InputError(f"{model}: does not say what is usual; give recordings of the unchanged machine with --usual")
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
    print_table(
        ("time in s", "joint", "residual", "threshold there", "unit", "score", "threshold"),
        [
            (
                *(f"{o.found:.2f}", loaded.joints[o.joint], f"{o.residual:.4g}", f"{o.limit:.4g}"),
                *(units[o.joint], f"{o.score:.1f}", f"{o.threshold:.1f}"),
            )
            for o in found
        ],
    )


def payload(
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

    found = payload_signal(*opened(model, recording, columns, resample))
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
    print_table(
        ("time in s", "mass in kg", "std"),
        [
            (f"{t:.1f}", "-", "-") if m != m else (f"{t:.1f}", f"{m:+.2f}", f"{s:.2f}")
            for t, m, s in list(zip(found.t, found.mass, found.std, strict=True))[::every]
        ],
    )
