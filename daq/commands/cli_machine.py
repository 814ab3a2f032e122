"""Commands about machine files: ``machine check``, ``machine new``, ``machine import``, ``machine schema``."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from daq.commands.cli_new import new
from daq.console import Json, may_be_written, print_json, reported
from daq.machine.machine_file import Machine, parse_machine


def register(app: typer.Typer) -> None:
    """Mount the commands."""
    machine = typer.Typer(help="Look at machine files.", no_args_is_help=True)
    machine.command("check")(reported(check))
    machine.command("new")(reported(new))
    machine.command("import")(reported(import_kinematics))
    machine.command("schema")(reported(schema))
    app.add_typer(machine, name="machine")


def check(
    file: Annotated[Path, typer.Argument(help="The machine file.")],
    draw: Annotated[
        Path | None, typer.Option(help="Draw every linkage, x(q) and r(q): a file .svg, or a folder.")
    ] = None,
    json: Json = False,
) -> None:
    """Say everything that is wrong or doubtful in a machine file, with line, key and cure; and what it describes."""
    from daq.machine.machine_check import check_machine, facts_of
    from daq.machine.travel import travel_of

    checked = check_machine(file)
    machine = checked.machine
    drawn = draw_pictures(machine, draw) if draw is not None and machine is not None else []
    if json:
        facts = {} if machine is None else facts_of(machine)
        findings = [asdict(finding) for finding in checked.findings]
        print_json(
            {
                **facts,
                "valid": machine is not None and not checked.errors,
                "findings": findings,
                "drawn": [str(p) for p in drawn],
            }
        )
        raise typer.Exit(2 if checked.errors else 0)
    for finding in checked.errors:
        print(f"hilfit: {finding.under(str(file))}", file=sys.stderr)
    if machine is not None:
        said = "for fitting a valid" if checked.errors else "a valid"
        print(f"{file}: {said} machine file ({machine.schema_})")
        for key, value in facts_of(machine).items():
            if key != "travel":
                print(f"  {key}: {value}")
        for joint in machine.joints:
            print(f"  {travel_of(joint).text()}")
    for finding in checked.findings:
        if finding.level == "warning":
            print(finding.under(str(file)))
    for path in drawn:
        print(f"drawn: {path}")
    if checked.errors:
        raise typer.Exit(2)


def draw_pictures(machine: Machine, target: Path) -> list[Path]:
    """The linkages' pictures; loading what draws takes a second, so only when asked."""
    from daq.machine.linkage_picture import draw_linkages

    return draw_linkages(machine, target)


def import_kinematics(
    source: Annotated[Path, typer.Argument(help="A URDF, xacro or MJCF file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Machine file to write.")] = Path("machine.yaml"),
    tip: Annotated[str | None, typer.Option(help="Link (body) where the arm ends, if it branches.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
    json: Json = False,
) -> None:
    """Make the kinematic part of a machine file from an arm's model; what it lacks is marked TODO."""
    from daq.kinematics import draft_machine, read_chain

    may_be_written(output, force)
    chain = read_chain(source, tip)
    text = draft_machine(chain, source.name)
    machine = parse_machine(text, name=str(output))
    output.write_text(text, encoding="utf-8")
    if json:
        print_json({"file": str(output), "joints": [joint.name for joint in machine.joints], "notes": chain.notes})
        return
    print(f"{output}: {len(machine.joints)} joints from {chain.base} to {chain.tip}")
    for note in chain.notes:
        print(f"note: {note}")
    todo = sum("TODO" in line for line in text.splitlines())
    print(f"{todo} lines say TODO; then: hilfit machine check {output}")


def schema() -> None:
    """Print the JSON schema of machine files, for editors."""
    print_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **Machine.model_json_schema()})
