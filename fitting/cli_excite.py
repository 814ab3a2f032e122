"""The command ``hilfit excite``: design a motion and write its motion file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from daq.console import print_json, progress_bar, reported
from daq.errors import InputError
from daq.machine_file import Machine, load_machine
from fitting.base_parameters import reduce_parameters
from fitting.excitation import (
    CylinderOptions,
    ExcitationOptions,
    HydraulicLimits,
    LimitUse,
    design_cylinder_motion,
    design_motion,
    information_of,
)
from fitting.geometry import geometry_of
from fitting.motion import Motion, read_motion, write_motion

_LITRES_PER_MINUTE = 1e-3 / 60  # m^3/s


def register(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command()(reported(excite))


def excite(
    machine: Annotated[Path, typer.Argument(help="The machine file.", metavar="MACHINE")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Motion file to write (CSV).")],
    joint: Annotated[list[str] | None, typer.Option(help="Move only this joint; may be given again.")] = None,
    seconds: Annotated[float | None, typer.Option(help="Length; 30 pinned, 60 unpinned.", min=1.0)] = None,
    unpinned: Annotated[bool, typer.Option("--unpinned", help="Free cylinders, for stage 1.")] = False,
    after: Annotated[
        list[Path] | None, typer.Option(help="Motion already made, to be complemented; may be given again.")
    ] = None,
    max_flow: Annotated[float | None, typer.Option(help="Supply flow in l/min.", min=1e-6)] = None,
    use: Annotated[float | None, typer.Option(help="Share of every limit to use; 0.95 pinned, 0.92 unpinned.")] = None,
    starts: Annotated[int, typer.Option(help="Random starts.", min=1, max=100)] = 2,
    seed: Annotated[int, typer.Option(help="Of the random starts.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Design a motion that tells the parameters: all joints, or free cylinders for stage 1."""
    described = load_machine(machine)
    with progress_bar("designing the motion", show=not json) as bar:

        def progress(share: float, _condition: float) -> None:
            bar(share, 1.0)

        if unpinned:
            if after or max_flow is not None:
                raise InputError("--after and --max-flow are for pinned rods; leave them out with --unpinned")
            motion, result = _free_cylinders(described, joint, seconds, use, starts, seed, progress)
        else:
            motion, result = _whole_arm(described, joint, seconds, use, starts, seed, after or [], max_flow, progress)
    write_motion(output, motion)
    if json:
        print_json({"file": str(output), "machine": described.name, "rods": motion.rods, **result})
    else:
        _show(output, motion, result)


def _whole_arm(
    machine: Machine,
    joints: Sequence[str] | None,
    seconds: float | None,
    use: float | None,
    starts: int,
    seed: int,
    after: Sequence[Path],
    max_flow: float | None,
    progress: Callable[[float, float], None],
) -> tuple[Motion, dict[str, Any]]:
    base = reduce_parameters(geometry_of(machine).uncoupled())
    options = replace(ExcitationOptions(), starts=starts)
    options = options if seconds is None else replace(options, seconds=seconds)
    options = options if use is None else replace(options, use=use)
    gathered = np.zeros((len(base), len(base)))
    for path in after:
        gathered += information_of(machine, base, read_motion(path, machine))
    found = design_motion(
        machine,
        base,
        seed=seed,
        options=options,
        joints=joints or None,
        gathered=gathered if after else None,
        hydraulic=None if max_flow is None else HydraulicLimits(flow=max_flow * _LITRES_PER_MINUTE),
        progress=progress,
    )
    result = {
        "seconds": found.motion.seconds,
        "condition_number": found.condition_number,
        "own_condition_number": found.own_condition_number if np.isfinite(found.own_condition_number) else None,
        "base_parameters": len(base),
        "not_told": list(found.not_told),
        "limits": [asdict(limit) for limit in found.limits],
    }
    return found.motion, result


def _free_cylinders(
    machine: Machine,
    joints: Sequence[str] | None,
    seconds: float | None,
    use: float | None,
    starts: int,
    seed: int,
    progress: Callable[[float, float], None],
) -> tuple[Motion, dict[str, Any]]:
    options = replace(CylinderOptions(), starts=starts)
    options = options if seconds is None else replace(options, seconds=seconds)
    options = options if use is None else replace(options, use=use)
    found = design_cylinder_motion(machine, seed=seed, options=options, joints=joints or None, progress=progress)
    result = {
        "seconds": found.motion.seconds,
        "condition_number": max(found.condition_numbers.values()),
        "condition_numbers": found.condition_numbers,
        "limits": [asdict(limit) for limit in found.limits],
    }
    return found.motion, result


def _show(output: Path, motion: Motion, result: dict[str, Any]) -> None:
    console = Console()
    table = Table(title=f"limits used by {output.name}")
    for column in ("joint", "limit", "used", "reached", "of"):
        table.add_column(column, justify="left" if column in ("joint", "limit") else "right")
    for limit in (LimitUse(**each) for each in result["limits"]):
        table.add_row(
            limit.joint or "supply",
            limit.quantity,
            f"{100 * limit.used:.0f} %",
            f"{limit.reached:.4g}",
            f"{limit.limit:.4g} {limit.unit}",
        )
    console.print(table)
    what = "stage-1 regressor, worst cylinder" if motion.rods == "unpinned" else "base parameters"
    console.print(
        f"{output}: {motion.seconds:g} s, rods {motion.rods}, cond(W) {result['condition_number']:.3g} ({what})",
        highlight=False,
        soft_wrap=True,
    )
    if result.get("not_told"):
        console.print(f"this motion cannot tell: {', '.join(result['not_told'])}", highlight=False, soft_wrap=True)
