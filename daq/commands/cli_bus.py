"""Commands about buses: ``bus scan``, ``check``, ``monitor``, ``restore``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from daq.commands.cli_check import check, monitor
from daq.commands.cli_scan import scan
from daq.console import Json, MachineFile, print_json, reported
from daq.machine.machine_file import load_machine

DATA_DIRECTORY = Path("hilfit-data")
DataDirectory = Annotated[
    Path, typer.Option("--data-dir", help="Where it is kept what nodes were like before they were changed.")
]


def register(app: typer.Typer) -> None:
    """Mount the commands."""
    bus = typer.Typer(help="Look after the devices of a machine's buses.", no_args_is_help=True)
    bus.command("scan")(reported(scan))
    bus.command("check")(reported(check))
    bus.command("monitor")(reported(monitor))
    bus.command("restore")(reported(restore))
    app.add_typer(bus, name="bus")


def restore(
    machine: MachineFile,
    data_dir: DataDirectory = DATA_DIRECTORY,
    json: Json = False,
) -> None:
    """Put CANopen nodes back to what they were before hilfit changed them: mapping, transmission type, heartbeat."""
    from daq.drivers.canopen.restore import restore_nodes

    results = restore_nodes(load_machine(machine), data_dir)
    failed = any(result.failure for result in results)
    if json:
        print_json([asdict(result) for result in results])
        raise typer.Exit(1 if failed else 0)
    for result in results:
        print(result.failure or f"bus '{result.bus}' node {result.node}: is as it was found")
    if not results:
        print(f"{data_dir}: nothing is kept of this machine's nodes, so there is nothing to put back")
    raise typer.Exit(1 if failed else 0)
