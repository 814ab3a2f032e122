"""``hilfit doctor``: whether this computer is ready, a line each with what to do."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.console import print_json, reported

if TYPE_CHECKING:
    from server.commands.doctor_probes import Line

_MARKS = {"ok": "ok     ", "note": "note   ", "problem": "PROBLEM"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("doctor")(reported(doctor))


def doctor(
    machine: Annotated[
        Path | None, typer.Argument(help="Machine file whose CAN interfaces have to be there.", show_default=False)
    ] = None,
    data_dir: Annotated[Path, typer.Option(help="Data directory of the service.")] = Path("hilfit-data"),
    config: Annotated[
        Path | None, typer.Option(help="Settings of the service (YAML).", dir_okay=False, show_default=False)
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Check that this computer is ready: libraries, permissions, scheduling, CAN, time. Exit code 1 on a problem."""
    found = list(_look(machine, data_dir, config))
    problems = sum(line.level == "problem" for line in found)
    if json:
        print_json({"ready": not problems, "lines": [asdict(line) for line in found]})
    else:
        for line in found:
            print(f"{_MARKS[line.level]} {line.topic:17s} {line.text}")
            if line.do:
                print(f"{'':25s} -> {line.do}")
        print(f"{problems} problem{'s' if problems != 1 else ''}" if problems else "ready")
    if problems:
        raise typer.Exit(1)


def _look(machine: Path | None, data_dir: Path, config: Path | None) -> Iterator[Line]:
    from server.commands import doctor_probes as probes
    from server.platform.settings import load_settings

    wanted = None if machine is None else _interfaces(machine)
    yield probes.program()
    yield from probes.libraries()
    yield from probes.environment(os.environ, _known_variables())
    yield probes.data_directory(data_dir)
    yield probes.shared_memory()
    yield probes.scheduling()
    yield probes.precedence()
    yield from probes.can_interfaces(wanted=wanted)
    yield from probes.serial_ports()
    yield probes.confinement()
    settings = load_settings(config)
    yield probes.bus_places(settings.bus_places)
    yield probes.webhook_places(settings.webhook_places)
    yield probes.time_is_synchronised()
    yield probes.clock_source()


def _interfaces(machine: Path) -> dict[str, str]:
    """Map network interface to name of the bus, for buses that are one."""
    from daq.machine.buses import CanopenBus, CanSignalsBus
    from daq.machine.machine_file import load_machine

    buses = [bus for bus in load_machine(machine).buses if isinstance(bus, (CanopenBus, CanSignalsBus))]
    return {str(bus.channel): bus.name for bus in buses if bus.interface == "socketcan"}


def _known_variables() -> dict[str, str]:
    """Return what reads a variable of the environment, by its name."""
    from server.commands.command_line import every_command
    from server.commands.conventions import Parameter
    from server.platform.settings import Settings

    known = {f"HILFIT_{name.upper()}": "the service" for name in Settings.model_fields}
    for words, command in every_command():
        for parameter in (Parameter(words, own) for own in command.params):
            if parameter.option is not None and parameter.own.envvar is not None:
                known.setdefault(str(parameter.own.envvar), f"{parameter.option} of 'hilfit {words}'")
    return known
