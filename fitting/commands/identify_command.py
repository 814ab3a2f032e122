"""Command line of the fitting side: ``identify`` and ``effects``."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.console import print_json, progress_bar, reported, show_table
from daq.errors import InputError
from daq.messages import Sentence
from fitting.commands import Columns, Files, Resample
from fitting.pipeline.stage_names import ReportLanguage


def register(app: typer.Typer) -> None:
    """Mount the commands."""
    app.command("identify")(reported(_identify))
    catalogue = typer.Typer(help="The catalogue of physical effects.", no_args_is_help=True)
    catalogue.command("list")(reported(_list_effects))
    catalogue.command("show")(reported(_show_effect))
    app.add_typer(catalogue, name="effects")


Estimator = Annotated[
    str,
    typer.Option(help="What is handed out: gls (both stages at once, plausible arm), ols, wls, ridge, possible."),
]
Spoken = Annotated[ReportLanguage, typer.Option(help="Language of report.html.")]


def _identify(
    machine: Annotated[Path, typer.Argument(help="Machine file.")],
    train: Annotated[Files, typer.Option(help="Training recording; may be given several times.")] = None,
    validate: Annotated[Files, typer.Option(help="Recording of another motion, to judge by.")] = None,
    unloaded: Annotated[Files, typer.Option(help="Recording with the rods unpinned.")] = None,
    repeat: Annotated[Files, typer.Option(help="The training motion once more: gives the noise floor.")] = None,
    operation: Annotated[Files, typer.Option(help="Whatever the machine did that day.")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory of the report.")] = Path("hilfit-report"),
    no_loop: Annotated[bool, typer.Option("--no-loop", help="Both stages only.")] = False,
    bootstrap: Annotated[
        int, typer.Option(min=0, max=1000, help="Most replicas that a null distribution is drawn from; 0 for none.")
    ] = 18,
    bandwidth: Annotated[
        float | None, typer.Option(help="Identification bandwidth in Hz; from the motion if absent.")
    ] = None,
    estimator: Estimator = "gls",
    covariance: Annotated[
        str, typer.Option(help="Deviations for coloured residuals: hac, bootstrap or white.")
    ] = "hac",
    prior: Annotated[
        Path | None, typer.Option(help="Links from drawings, or an earlier report.json, for ridge and possible.")
    ] = None,
    columns: Columns = None,
    resample: Resample = False,
    language: Spoken = "en",
    json: Annotated[bool, typer.Option("--json", help="Print report.json on standard output.")] = False,
) -> None:
    """Identify an arm from recordings, find what the model lacks, and write report.json and report.html."""
    from fitting.loop.session import Options, Request
    from fitting.pipeline.stages import identify

    roles = {"unloaded": unloaded, "train": train, "repeat": repeat, "validate": validate, "operation": operation}
    recordings = tuple((role, path) for role, paths in roles.items() for path in paths or ())
    if not train and not operation:
        raise InputError("fitting.identify_without_training")
    if not validate and not operation:
        raise InputError("fitting.identify_without_validation")
    options = Options(
        loop=not no_loop,
        bandwidth_hz=bandwidth,
        bootstrap=bootstrap,
        estimator=estimator,
        covariance=covariance,
        prior=None if prior is None else str(prior),
        columns=None if columns is None else str(columns),
        resample=resample,
    )
    request = Request(machine, recordings, output, options, (language,))
    with progress_bar("identify", show=not json) as bar:
        content = identify(request, lambda fraction, text: bar(fraction, 1.0, text))
    if json:
        print_json(content)
        return
    from fitting.pipeline.results.summary import print_summary

    print_summary(content, output)


def _list_effects(json: Annotated[bool, typer.Option("--json", help="For programs.")] = False) -> None:
    """List all effects that the loop knows."""
    from fitting.effects import effects

    if json:
        print_json([{"id": e.id, "title": e.title, "level": e.level} for e in effects()])
        return
    from rich.table import Table

    table = Table("id", "level", "what it is", box=None)
    for entry in effects():
        table.add_row(entry.id, entry.level, entry.title)
    show_table(table)


def _show_effect(
    effect_id: Annotated[str, typer.Argument(metavar="ID", help="Effect id, as in the list.")],
    json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Show one effect: equation, parameters, alternatives, and the experiment that separates them."""
    from fitting.effects import effect, effects

    try:
        entry = effect(effect_id)
    except KeyError:
        near = difflib.get_close_matches(effect_id, [one.id for one in effects()], n=1)
        meant = Sentence("fitting.did_you_mean", near=near[0]) if near else ""
        raise InputError("fitting.effect_unknown", effect=effect_id, hint=meant, count=len(effects())) from None
    content: dict[str, Any] = {
        "id": entry.id,
        "title": entry.title,
        "level": entry.level,
        "equation": entry.equation,
        "parity": entry.dependence,
        "parameters": [{"name": p.name, "unit": p.unit} for p in entry.parameters],
        "confounders": list(entry.confounders),
        "experiment": entry.experiment,
        "source": entry.source,
    }
    if json:
        print_json(content)
        return
    for key, value in content.items():
        text = ", ".join(f"{p['name']} [{p['unit']}]" for p in value) if key == "parameters" else value
        print(f"{key:12s} {', '.join(text) if isinstance(text, list) else text}")
