"""``hilfit bench``: every benchmark by name; targets beside what was measured, exit code 1 if one is missed."""

from __future__ import annotations

from importlib import import_module
from inspect import getdoc
from typing import Annotated

import typer

from benchmarks.commands.benchmark import BENCHMARKS
from daq.console import print_json

#: Modules whose commands there are, in the order of the list.
for _module in ("loop", "model", "service"):
    import_module(f"benchmarks.commands.{_module}_commands")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    bench = typer.Typer(help="Benchmarks with targets; exit code 1 if a target is missed.", invoke_without_command=True)
    bench.callback()(_list)
    for name, command in BENCHMARKS.items():
        bench.command(name)(command)
    app.add_typer(bench, name="bench")


def _list(
    context: typer.Context, json: Annotated[bool, typer.Option("--json", help="Print the list as JSON.")] = False
) -> None:
    """List benchmarks with targets."""
    if context.invoked_subcommand is not None:
        return
    texts = {name: str(getdoc(command)) for name, command in BENCHMARKS.items()}
    if json:
        print_json([{"name": name, "shows": text} for name, text in texts.items()])
        return
    for name, text in texts.items():
        print(f"{name:14s} {text}")
