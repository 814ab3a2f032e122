"""``hilfit machine new``: the ``buses`` and ``channels`` part of a machine file, step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from daq.console import may_be_written, print_json
from daq.errors import InputError


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
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON; asks nothing.")] = False,
) -> None:
    """Make the buses and channels of a machine file from a scan, EDS and DBC files; asks what each value is."""
    may_be_written(output, force)
    if not (scan or eds or dbc):
        raise InputError("machine new: says nothing about devices; give --scan, --eds or --dbc")
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
