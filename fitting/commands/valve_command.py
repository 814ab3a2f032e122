"""``hilfit valve``: command to speed of every axis, what its model lacks, and the inverse for a controller."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.console import MachineFile, print_json, progress_bar, reported, show_table
from fitting.commands import Columns, Files, Resample


def register(app: typer.Typer) -> None:
    """Mount the command."""
    app.command("valve")(reported(_valve))


def _valve(
    machine: MachineFile,
    recordings: Annotated[list[Path], typer.Argument(help="Recordings with commands, positions and pressures.")],
    validate: Annotated[Files, typer.Option(help="Recording of another motion, to judge by.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory of the report.")] = Path("hilfit-valve"),
    no_loop: Annotated[bool, typer.Option("--no-loop", help="Look for no effects.")] = False,
    bandwidth: Annotated[float | None, typer.Option(help="Of the filter in Hz; 3, or a fifth of the rate.")] = None,
    columns: Columns = None,
    resample: Resample = False,
    to: Annotated[
        list[str] | None,
        typer.Option(help="Write the inverse, too: c, csv, fmu, python or st; may be given several times."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print valve.json on standard output.")] = False,
) -> None:
    """Identify what speed a command gives, from recordings with commands, and write valve.json."""
    from daq.errors import InputError
    from fitting.loop.session import Options, Request
    from fitting.pipeline.valve_stage import identified_and_written
    from fitting.valve.export import require_formats

    require_formats(to or [])
    if output.exists() and not output.is_dir():
        raise InputError("fitting.folder_is_file", path=output)
    options = Options(not no_loop, bandwidth, columns=None if columns is None else str(columns), resample=resample)
    files = [*(("operation", path) for path in recordings), *(("validate", path) for path in validate or [])]
    with progress_bar("valve", show=sys.stderr.isatty() and not json) as bar:
        request = Request(machine, tuple(files), output, options)
        report, inverses = identified_and_written(request, to or [], lambda share, text: bar(share, 1.0, text))
    if json:
        print_json(report)
        return
    print_valves(report)
    print("\n".join([f"report: {output / 'valve.json'}", *(f"inverse: {file}" for file in inverses)]))


def print_valves(report: Mapping[str, Any]) -> None:
    """Print the report in a few lines on a terminal."""
    from rich.console import Console
    from rich.table import Table

    from fitting.report.text import number, share

    console = Console()
    curves = Table("axis", "way", "edge (2 % of full speed)", "command", "speed at largest", "law of the pressure")
    for name, own in report["axes"].items():
        for way, found in own["directions"].items():
            if not found["moves"]:
                curves.add_row(name, way, "never seen to move", "", "", "")
                continue
            edge, fastest = found["edge_at_2_percent"], found["speed_at_largest"]
            curves.add_row(
                name,
                way,
                _with_bar(edge),
                f"{number(edge['command'], 4)} {edge['command_unit']}",
                f"{number(fastest['value'])} m/s",
                found["law"]["title"],
            )
    show_table(curves, console)
    seen = all(own["errors"]["role"] == "validate" for own in report["axes"].values())
    title = "error over the speed's RMS, on " + ("the other motion" if seen else "what was fitted: give --validate")
    errors = Table("axis", "delay", "before", "after", "handed out", "static", "ARX(2,2)", "linear", title=title)
    for name, own in report["axes"].items():
        shown = [share(own["errors"][key]) for key in ("before", "after", "handed_out", "static", "arx", "linear")]
        errors.add_row(name, f"{_with_bar(own['delay'])} s", *shown)
    show_table(errors, console)
    for name, own in report["axes"].items():
        for line in _sentences(name, own):
            console.print(line, soft_wrap=True, markup=False, highlight=False)
    for warning in report["warnings"]:
        console.print(f"note: {warning}", soft_wrap=True, markup=False, highlight=False)


def _with_bar(value: Mapping[str, Any]) -> str:
    from fitting.report.text import number, with_std

    return number(value["value"]) if value["std"] is None else with_std(value["value"], value["std"])


def _sentences(name: str, own: Mapping[str, Any]) -> list[str]:
    from fitting.report.text import number, share

    lines = [f"{name}: {check['text']}; {check['cure']}" for check in own["checks"]]
    for found in (*own["effects"], *own["unexplained"]):
        alike = found["indistinguishable_from"]
        lines.append(
            f"{name}: {found['title']} (probability {number(found['probability'], 2)}): on rows left out "
            f"{share(found['error_before'])} -> {share(found['error_after'])}"
            + (f"; not to be told from {', '.join(alike)}: {found.get('experiment', '')}" if alike else "")
        )
    if own["verdict"] == "nothing_missing":
        lines.append(f"{name}: no effect stands out of what is left")
    most = [
        f"{number(own[key]['value'] * per)} {unit}"
        for key, per, unit in (("pump_limit", 6e4, "l/min"), ("pump_power", 1e-3, "kW"))
        if own[key] is not None
    ]
    if most:
        lines.append(f"{name}: the pump gives at most {' or '.join(most)}")
    reasons = {
        "before": "what was found does not hold on the other motion; the model without it is handed out",
        "static": "on the other motion nothing is better than a static curve, which is handed out",
    }
    if own["handed_out"] in reasons:
        lines.append(f"{name}: {reasons[own['handed_out']]}")
    return lines
