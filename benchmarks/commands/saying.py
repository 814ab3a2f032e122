"""How every benchmark says what it does and what came of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import typer

from daq.console import print_json

if TYPE_CHECKING:
    from benchmarks.targets import Outcome


def shown(json: bool) -> Callable[[str], None]:
    """What lines of progress go to: the terminal, or nowhere where JSON is printed."""
    return (lambda line: None) if json else (lambda line: print(line, flush=True))


def finish(name: str, outcome: Outcome, json: bool) -> None:
    """Print checks beside their targets; exit code 1 if one is missed."""
    from benchmarks.targets import lines_of, missed

    if json:
        print_json({"benchmark": name, "checks": [check.as_json() for check in outcome.checks]})
    else:
        print("\n".join([*outcome.notes, *lines_of(outcome.checks)]) or "nothing to check")
    if missed(outcome.checks):
        raise typer.Exit(1)
