"""The report in a few lines on a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from daq.console import show_table


def print_summary(report: Mapping[str, Any], output: Path) -> None:
    """Print the table of errors, the verdict and where the report is."""
    from fitting.report.languages import NAMES
    from fitting.report.text import change, number, percent, share
    from fitting.report.wording import readable, resolution, verdict_sentence

    console = Console()
    role = "validate" if any(e["after"]["validate"] is not None for e in report["errors"].values()) else "train"
    motion = {"validate": "validation", "train": "training"}[role]
    for own in report.get("checks", []):
        serious = own.get("severity") == "mistake"
        line = "; ".join(part for part in (own["text"], own["cure"]) if part)
        console.print(f"{'MISTAKE' if serious else 'note'}: {line}", soft_wrap=True, markup=False)
    table = Table("joint", "unit", "noise floor", "before", "after", "change", title=f"error on the {motion} motion")
    sizes = Table("joint", "unit", "RMS before", "after", "mean before", "after", "relative before", "after")
    for joint, errors in report["errors"].items():
        pair = errors["before"], errors["after"]
        before, after = (entry[role] for entry in pair)
        shown = map(number, (errors["noise_floor"], before, after))
        table.add_row(joint, errors["unit"], *shown, percent(change(before, after)))
        more = [number(entry.get(f"{role}_{size}")) for size in ("rms", "mean") for entry in pair]
        sizes.add_row(joint, errors["unit"], *more, *(share(entry.get(f"{role}_relative")) for entry in pair))
    show_table(table, console)
    show_table(sizes, console)
    relative = report["overall"].get("relative")
    if relative:
        console.print(
            f"relative error of all joints: {share(relative['before'])} before, {share(relative['after'])} after"
            f" ({NAMES['relative_of'][relative['of']]})",
            soft_wrap=True,
            highlight=False,
        )
    loop = report["loop"]
    titles = {e["id"]: e["title"] for e in (*loop["candidates"], *loop["effects"]) if e.get("title")}
    for step in resolution(loop, titles):
        console.print(f"ambiguous: {step['before']}", soft_wrap=True, markup=False, highlight=False)
        console.print(f"recorded:  {readable(step['motion'])}", soft_wrap=True, markup=False, highlight=False)
        console.print(f"now:       {step['after']}", soft_wrap=True, markup=False, highlight=False)
    console.print(verdict_sentence(report, titles), soft_wrap=True)
    if report.get("one_shot", {}).get("comparison"):
        console.print(report["one_shot"]["comparison"]["said"], soft_wrap=True, markup=False)
    for warning in report["warnings"]:
        console.print(f"note: {warning}", soft_wrap=True, markup=False)
    console.print(f"report: {output / 'report.html'}", soft_wrap=True, markup=False)
