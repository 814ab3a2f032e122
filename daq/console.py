"""Common parts of the command lines: errors as one line and an exit code, progress bars, JSON on standard output.

Exit codes: 0 done, 1 failed, 2 bad usage or input.
"""

from __future__ import annotations

import contextlib
import functools
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ParamSpec, Protocol, TypeVar

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from daq.errors import HilfitError, InputError

#: Of every command that a program may call, that writes one file, and that is about one machine.
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Force = Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")]
MachineFile = Annotated[Path, typer.Argument(help="The machine file.", metavar="MACHINE")]

#: Seconds over which the speed is averaged that the remaining time is told from: stages report far apart.
_SPEED_PERIOD = 180.0
#: Columns of a terminal on which every table fits.
_ANY_WIDTH = 10_000

P = ParamSpec("P")
R = TypeVar("R")


class ShowProgress(Protocol):
    """Called with what is done, how much there is, and (optionally) what is being done."""

    def __call__(self, done: float, total: float | None, text: str | None = None) -> None: ...


def may_be_written(output: Path, force: bool) -> None:
    """Raise InputError if a file is there that nobody wants to be replaced."""
    if output.exists() and not force:
        raise InputError("daq.output_there_already", output=output)


def _exit_code(error: HilfitError) -> int:
    """Return 2 where the input is wrong, 1 where something failed."""
    return 2 if isinstance(error, InputError) else 1


def reported(command: Callable[P, R]) -> Callable[P, R]:
    """Turn a command's errors into one line on standard error and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            _refuse_output_onto_input(kwargs)
            return command(*args, **kwargs)
        except HilfitError as error:
            print(f"hilfit: {error}", file=sys.stderr)
            raise typer.Exit(_exit_code(error)) from None
        except OSError as error:  # a disk or a directory that refuses: nothing a traceback would explain better
            if error.filename is None:
                raise
            print(f"hilfit: {error.filename}: {error.strerror}; choose another place", file=sys.stderr)
            raise typer.Exit(1) from None

    return run


def _refuse_output_onto_input(given: Mapping[str, Any]) -> None:
    """Refuse to replace a file that the command reads by ``output``, unless ``force`` allows it."""
    output = given.get("output")
    if not isinstance(output, Path) or given.get("force"):
        return
    for name, value in given.items():
        for path in value if isinstance(value, list) else [value]:
            same = name != "output" and isinstance(path, Path) and path.is_file() and output.is_file()
            if same and path.samefile(output):
                raise InputError("daq.output_is_input", output=output)


def print_json(value: Any) -> None:
    """Print one JSON document on standard output, for programs."""
    print(json.dumps(value, default=str))


def show_table(table: Table, console: Console | None = None) -> None:
    """Print a table; on a terminal where not every word of it fits, each row is a paragraph, and nothing is cut."""
    console = console or Console()
    if console.measure(table, options=console.options.update(max_width=_ANY_WIDTH)).minimum <= console.width:
        console.print(table)
        return
    if table.title:
        console.print(table.title)
    names = [str(column.header) for column in table.columns]
    for first, *rest in zip(*(column.cells for column in table.columns), strict=True):
        console.print(f"{first}: " + ", ".join(f"{name} {cell}" for name, cell in zip(names[1:], rest, strict=True)))


@contextlib.contextmanager
def progress_bar(what: str, *, show: bool = True) -> Iterator[ShowProgress]:
    """Show a progress bar on standard error; call what it yields with (done, total[, text]), total None if open.

    Who interrupts is shown what was being done.
    """
    doing = what

    def noted(done: float, total: float | None, text: str | None = None) -> None:
        nonlocal doing
        doing = text or doing
        update(done, total, text)

    try:
        with _bar(what, show) as update:
            yield noted
    except KeyboardInterrupt:
        print(f"hilfit: interrupted ({doing})", file=sys.stderr)
        raise


@contextlib.contextmanager
def _bar(what: str, show: bool) -> Iterator[ShowProgress]:
    if not show:
        yield lambda done, total, text=None: None
        return
    if not sys.stderr.isatty():
        yield _lines(what)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, speed_estimate_period=_SPEED_PERIOD) as bar:
        task = bar.add_task(what, total=None)

        def update(done: float, total: float | None, text: str | None = None) -> None:
            bar.update(task, completed=done, total=total, description=text)

        yield update


@contextlib.contextmanager
def working(what: str, *, show: bool = True) -> Iterator[None]:
    """Show a spinner with the time so far, on a terminal only, for work of unknown length."""
    if not show or not sys.stderr.isatty():
        yield
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        bar.add_task(what, total=None)
        yield


def _lines(what: str) -> ShowProgress:
    """Log progress: one line whenever what is being done changes."""
    last = ""

    def update(done: float, total: float | None, text: str | None = None) -> None:
        nonlocal last
        text = text or what
        if text != last:
            share = f"{100 * done / total:3.0f} %" if total else f"{done:g}"
            print(f"[{share}] {text}", file=sys.stderr, flush=True)
            last = text

    return update
