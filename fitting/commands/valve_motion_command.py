"""``hilfit valve-motion``: plan the motions from which valves are identified."""

from __future__ import annotations

import json as json_text
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.console import MachineFile, print_json, reported
from daq.errors import InputError


def register(app: typer.Typer) -> None:
    """Mount the command."""
    app.command("valve-motion")(reported(_valve_motion))


def _valve_motion(
    machine: MachineFile,
    output: Annotated[Path, typer.Option("--output", "-o", help="Directory of tables and programs.")] = Path(
        "valve-motions"
    ),
    joint: Annotated[list[str] | None, typer.Option(help="Only the motion of this axis; may be given again.")] = None,
    after: Annotated[
        Path | None, typer.Option(help="valve.json of an earlier identification, for what is expected.")
    ] = None,
    level: Annotated[float, typer.Option(help="Largest command as a share of full.", min=0.05, max=1.0)] = 0.8,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Plan what the arm's controller is to do with its valves: a table and a Structured Text program per axis."""
    from daq.machine.machine_file import load_machine
    from fitting.planning.excite_text import show
    from fitting.valve.motion import expected_of, plan_valve_motions, written_plan

    described, report = load_machine(machine), None if after is None else _report(after)
    found = plan_valve_motions(described, joint, report, level)
    motions: list[dict[str, Any]] = []
    for planned in found:
        table, program = written_plan(planned, output)
        levels = ", ".join(f"{own.axis} {100 * own.most:.0f} %" for own in planned.motion.axes)
        motions.append({
            "file": str(table), "program": str(program), "seconds": round(planned.seconds),
            "experiment": "valve", "does": f"commands at most: {levels} of full; program {program}",
            "limits": [asdict(use) for use in planned.limits],
        })  # fmt: skip
    guessed = [own.joint.name for own in expected_of(described, report) if not own.from_report]
    notes = [
        "limits are those of valves that give 30 % more than expected; obstacles are known by limits.position alone"
    ]
    if guessed:
        notes.append(
            f"{', '.join(guessed)}: full command is expected to give the largest speed of the machine file, a quarter "
            "of a second late; begin with a small --level, then give --after with the valve.json of that"
        )
    result = {"machine": described.name, "rods": "pinned", "motions": motions, "notes": notes}
    if json:
        print_json(result)
    else:
        show(result)


def _report(path: Path) -> dict[str, Any]:
    try:
        content = json_text.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError("fitting.not_a_valve_report", path=path) from None
    return content if isinstance(content, dict) else {}
