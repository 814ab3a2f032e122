"""The report in a few lines on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table


def print_summary(report: Mapping[str, Any], output: Path) -> None:
    """Print the table of errors, the verdict and where the report is."""
    from fitting.report.wording import verdict_sentence

    console = Console()
    table = Table("joint", "unit", "noise floor", "before", "after", "change", title="error on the validation motion")
    for joint, errors in report["errors"].items():
        before, after = errors["before"]["validate"], errors["after"]["validate"]
        if before is None:
            before, after = errors["before"]["train"], errors["after"]["train"]
        change = (
            "-"
            if not before or after is None
            else f"{100 * (after / before - 1):+.0f} %".replace("-0 %", "0 %").replace("+0 %", "0 %")
        )
        numbers = ("-" if n is None else f"{n:.3g}" for n in (errors["noise_floor"], before, after))
        table.add_row(joint, errors["unit"], *numbers, change)
    console.print(table)
    titles = {entry["id"]: entry["title"] for entry in report["loop"]["effects"]}
    console.print(verdict_sentence(report, titles), soft_wrap=True)
    if report.get("one_shot", {}).get("comparison"):
        console.print(report["one_shot"]["comparison"]["said"], soft_wrap=True, markup=False)
    for warning in report["warnings"]:
        console.print(f"note: {warning}", soft_wrap=True, markup=False)
    console.print(f"report: {output / 'report.html'}", soft_wrap=True, markup=False)
