"""Parts of every command below ``hilfit bench``: options of its own, ``--json``, and what came of it."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.targets import Outcome, Show, lines_of, missed, silent
from daq.console import print_json, reported
from daq.errors import InputError

#: Options of benchmarks whose cases are drawn from a seed, kept on disk, and judged into a file of results.
Seed = Annotated[int, typer.Option(help="Seed of the run; a case is the same whatever else is run.")]
Cache = Annotated[Path | None, typer.Option(help="Keep simulated cases here, and take them from here.")]
OnlyMake = Annotated[bool, typer.Option(help="Fill the cache and judge nothing.")]
Results = Annotated[
    Path | None, typer.Option("-o", "--output", help="Results, a line each; a run goes on where it stopped.")
]
#: Commands by name, in the order of the list.
BENCHMARKS: dict[str, Callable[..., None]] = {}


def benchmark(run: Callable[..., Outcome]) -> Callable[..., Outcome]:
    """Make ``hilfit bench NAME`` of a function of that name; its docstring is its help.

    Parameters
    ----------
    run : gives the outcome; its parameters are the options of the command, but for ``show``, which gets lines of
        progress: for the terminal, or for nobody where JSON is printed
    """
    signature = inspect.signature(run, eval_str=True)
    json_option = Annotated[bool, typer.Option("--json", help="Print the checks, and what was measured, as JSON.")]
    options = [own for own in signature.parameters.values() if own.name != "show"]
    json_parameter = inspect.Parameter("json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=json_option)

    @functools.wraps(run)
    def command(json: bool = False, **given: Any) -> None:
        show: Show = silent if json else (lambda line: print(line, flush=True))
        outcome = run(**given, **({"show": show} if "show" in signature.parameters else {}))
        if json:
            checks = [check.as_json() for check in outcome.checks]
            print_json({"benchmark": run.__name__, "checks": checks, **outcome.content})
        else:
            print("\n".join([*outcome.notes, *lines_of(outcome.checks)]) or "nothing to check")
        if missed(outcome.checks):
            raise typer.Exit(1)

    vars(command)["__signature__"] = inspect.Signature([*options, json_parameter])
    command.__annotations__ = {own.name: own.annotation for own in (*options, json_parameter)}
    BENCHMARKS[run.__name__] = reported(command)
    return run


def chosen(option: str, value: str | None, names: Sequence[str], what: str, *, part: bool = False) -> None:
    """Refuse a value that is none of some names; with ``part``, that is part of none."""
    if value is not None and not any(value in name if part else value == name for name in names):
        raise InputError(f"{option} {value}: {what} {', '.join(names)}")


def directory(path: Path | None, usual: Path, what: str) -> Path:
    """Return a directory that was given and is there, or the usual one."""
    if path is not None and not path.is_dir():
        raise InputError(f"{path}: no such directory; give {what}")
    return path or usual


def rising(option: str, text: str, example: str) -> list[float]:
    """Parse rising numbers of at least 1 from a text with commas."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if not numbers or numbers != sorted(set(numbers)) or numbers[0] < 1:
        raise InputError(f"{option} {text}: write rising numbers of at least 1 with commas, as in {example}")
    return numbers
