"""Texts that ``hilfit excite`` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from daq.console import show_table
from fitting.excitation.limits import LimitUse


def show(result: Mapping[str, Any]) -> None:
    """Print tables of limits and of the forecast, a line per motion file; ``result`` as ``--json`` prints it."""
    console = Console()
    for motion in result["motions"]:
        if motion["limits"]:
            show_table(_limits(motion), console)
        console.print(_line(motion, result["rods"]), highlight=False, soft_wrap=True)
        if motion.get("not_told"):
            console.print(f"this motion cannot tell: {', '.join(motion['not_told'])}", highlight=False, soft_wrap=True)
    for note in result["notes"]:
        console.print(note, highlight=False, soft_wrap=True)
    if "forecast" in result:
        show_table(_effects(result["forecast"]), console)
        for line in (result["forecast"]["parameters_statement"], f"forecast made with {result['forecast']['basis']}"):
            console.print(line, highlight=False, soft_wrap=True)


def _line(motion: Mapping[str, Any], rods: str) -> str:
    head = f"{motion['file']}: {motion['seconds']:g} s, rods {rods}"
    if "experiment" in motion:
        return f"{head}, {motion['does']}"
    what = "stage-1 regressor, worst cylinder" if rods == "unpinned" else "base parameters"
    if motion["condition_number"] is None:
        return f"{head}, cannot tell all parameters"
    return f"{head}, cond(W) {motion['condition_number']:.3g} ({what})"


def _limits(motion: Mapping[str, Any]) -> Table:
    table = Table(title=f"limits used by {motion['file']}")
    for column in ("joint", "limit", "used", "reached", "of"):
        table.add_column(column, justify="left" if column in ("joint", "limit") else "right")
    for limit in (LimitUse(**each) for each in motion["limits"]):
        table.add_row(
            limit.joint or "supply",
            limit.quantity,
            f"{100 * limit.used:.0f} %",
            f"{limit.reached:.4g}",
            f"{limit.limit:.4g} {limit.unit}",
        )
    return table


def _effects(forecast: Mapping[str, Any]) -> Table:
    """Make a row per effect: over its joints, what survives of it, and the smallest size to be found."""
    table = Table(title=f"smallest effect that will be found with {100 * forecast['power']:.0f} % probability")
    table.add_column("effect", no_wrap=True)
    table.add_column("survives", justify="right")
    table.add_column("smallest", justify="right")
    table.add_column("unit")
    table.add_column("joints")
    rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for entry in forecast["effects"]:
        rows.setdefault((entry["id"], entry["unit"]), []).append(entry)
    for (name, unit), entries in rows.items():
        seen = [entry for entry in entries if entry["smallest"] is not None]
        where = "all" if len(seen) == len(entries) else ", ".join(entry["joint"] for entry in seen) or "none"
        shares, sizes = ([entry[key] for entry in seen] for key in ("surviving", "smallest"))
        table.add_row(name, _span(shares, ".2f"), _span(sizes, ".3g"), unit, where)
    return table


def _span(values: Sequence[float], digits: str) -> str:
    if not values:
        return ""
    low, high = format(min(values), digits), format(max(values), digits)
    return low if low == high else f"{low} to {high}"
