"""Commands about machine files: ``machine check``, ``machine new``, ``machine import``, ``machine schema``."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from daq.console import Force, Json, may_be_written, print_json, reported
from daq.errors import InputError
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
    """Report everything that is wrong or suspect in a machine file, with line, key and cure; and what it describes."""
    from daq.machine.machine_check import check_machine, facts_of
    from daq.machine.travel import travel_of

    checked = check_machine(file)
    machine = checked.machine
    drawn: list[Path] = []
    if draw is not None and machine is not None:
        from daq.machine.linkage_picture import draw_linkages  # loading what draws takes a second

        drawn = draw_linkages(machine, draw)
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
        kind = "for fitting a valid" if checked.errors else "a valid"
        print(f"{file}: {kind} machine file ({machine.schema_})")
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


def import_kinematics(
    source: Annotated[Path, typer.Argument(help="A URDF, xacro or MJCF file.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Machine file to write.")] = Path("machine.yaml"),
    tip: Annotated[str | None, typer.Option(help="Link (body) where the arm ends, if it branches.")] = None,
    force: Force = False,
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


def new(
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")],
    scan: Annotated[list[Path] | None, typer.Option(help="What 'bus scan -o' wrote (several times).")] = None,
    eds: Annotated[list[str] | None, typer.Option(help="NODE=FILE: EDS or DCF of a node (several times).")] = None,
    dbc: Annotated[list[Path] | None, typer.Option(help="DBC file of plain CAN or J1939 (several times).")] = None,
    interface: Annotated[str, typer.Option(help="CAN interface for --eds and --dbc without a scan.")] = "socketcan",
    channel: Annotated[str, typer.Option(help="Its channel.")] = "can0",
    joints: Annotated[
        Path | None, typer.Option(help="Machine file (of 'machine import') whose joints are taken over.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: take what is proposed.")] = False,
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON; asks nothing.")] = False,
) -> None:
    """Make the buses and channels of a machine file from a scan, EDS and DBC files; asks what each value is."""
    may_be_written(output, force)
    if not (scan or eds or dbc):
        raise InputError("daq.new_without_devices")
    from daq.commissioning.wizard import Origins, write_draft

    origins = Origins(scan or [], eds or [], dbc or [], interface, channel, joints)
    made = write_draft(output, origins, ask=not (yes or json))
    failed = bool(made.notes) and made.whole  # it is written all the same: what is to be corrected stands in it
    if json:
        counts = {"buses": made.buses, "channels": list(made.channels), "skipped": made.skipped}
        print_json({"file": str(output), **counts, "notes": list(made.notes)})
        raise typer.Exit(1 if failed else 0)
    print(f"{output}: {made.buses} buses, {len(made.channels)} channels; {made.skipped} values left out")
    for note in made.notes:
        print(f"note: {note}")
    after = f"hilfit machine check {output}" if made.whole else "add joints (hilfit machine import), and check it"
    print(f"then: {'correct that, then ' if failed else ''}{after}")
    raise typer.Exit(1 if failed else 0)
