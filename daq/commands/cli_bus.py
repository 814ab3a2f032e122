"""Commands about buses: ``bus scan``, ``check``, ``monitor``, ``restore``."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from daq.commands.cli_scan import scan
from daq.console import Json, MachineFile, print_json, progress_bar, reported, show_table
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine

if TYPE_CHECKING:
    from daq.commissioning.check import MachineCheck
    from daq.commissioning.delays import BusDelay

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
    from daq.drivers.canopen.commissioning import restore_nodes

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


_PAGE = (".html", ".htm")


def check(
    machine: MachineFile,
    seconds: Annotated[float, typer.Option(help="Of machine time, at rest.", min=2.0)] = 20.0,
    depressurised: Annotated[
        bool, typer.Option("--depressurised", help="Pump off, lines open: pressures have to be zero.")
    ] = False,
    recording: Annotated[
        list[Path] | None, typer.Option(help="A recording of a motion, for the delays between buses (several times).")
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Page to print: an HTML file.")] = None,
    json: Json = False,
) -> None:
    """Check every device of a machine: identity, units, mapping, latency, jitter, noise at rest, zero, drift."""
    from daq.commissioning.check import check_machine_buses, check_page

    if output is not None and output.suffix.lower() not in _PAGE:
        raise InputError("daq.page_not_html", output=output)
    described = load_machine(machine)
    delays = _recorded_delays(described, recording or [])
    with progress_bar("bus check", show=not json) as bar:
        found = check_machine_buses(described, seconds=seconds, depressurised=depressurised, progress=bar)
    if delays:
        notes = tuple(note for note in found.notes if "--recording" not in note)
        found = replace(found, delays=tuple(delays), notes=notes)
    if output is not None:
        output.write_text(check_page(found), encoding="utf-8")
    if json:
        print_json(asdict(found))
    else:
        _print_check(found, output)
    raise typer.Exit(1 if found.findings else 0)


def _recorded_delays(machine: Machine, recordings: list[Path]) -> list[BusDelay]:
    """Estimate delays between buses from recordings: the most precise of each pair of buses.

    Raises
    ------
    InputError
        If a recording cannot be read, or none of them shows a delay.
    """
    from daq.commissioning.delays import bus_delays
    from daq.recordings.recording import read_recording

    best: dict[tuple[str, str], BusDelay] = {}
    for path in recordings:
        content = read_recording(path, machine, "operation")
        for delay in bus_delays(machine, content.values, content.rate_hz):
            known = best.get((delay.bus, delay.reference))
            if known is None or delay.std < known.std:
                best[delay.bus, delay.reference] = delay
    if recordings and not best:
        raise InputError("daq.recording_without_delay", recording=recordings[0])
    return list(best.values())


def _delay_line(delay: BusDelay) -> str:
    """Write an entry of ``delays`` of a machine file."""
    return f"{{bus: {delay.bus}, behind: {delay.reference}, seconds: {delay.seconds:.5f}, std: {delay.std:.5f}}}"


def _print_check(found: MachineCheck, page: Path | None) -> None:
    """Print tables for people."""
    from rich.console import Console
    from rich.table import Table

    from daq.commissioning.check import number

    console = Console()
    devices = Table("bus", "device", "state", "what it says it is", "values in", "after, ms", "jitter, ms", box=None)
    for device in found.devices:
        latency = ("", "") if device.latency_ms is None else tuple(f"{value:.2f}" for value in device.latency_ms)
        what = device.identity.get("device", "") + (
            f" {serial}" if (serial := device.identity.get("serial number")) else ""
        )
        devices.add_row(device.bus, device.device, device.state, what, device.mapping, *latency)
    show_table(devices, console)
    channels = Table(
        "channel", "value", "unit", "raw", "noise", "step", "drift a minute", "age, ms", "came, %", box=None
    )
    for channel in found.channels:
        rest = channel.rest
        drift = "moves" if rest.moved else f"{number(rest.drift, 2)} ± {number(rest.drift_std, 1)}"
        values = (number(rest.mean), channel.unit, number(channel.raw, 7), number(rest.noise, 2), number(rest.step, 2))
        channels.add_row(channel.name, *values, drift, number(rest.age_ms, 3), f"{100 * rest.share:.1f}")
    show_table(channels, console)
    for delay in found.delays:
        joints = ", ".join(pair.joint for pair in delay.pairs)
        print(
            f"bus '{delay.bus}' is {1e3 * delay.seconds:.1f} ± {1e3 * delay.std:.1f} ms behind bus '{delay.reference}' "
            f"({delay.pairs[0].kind}s of {joints})"
        )
    if found.delays:
        print(f"for the machine file, as a prior of the fit: delays: [{', '.join(map(_delay_line, found.delays))}]")
    for note in found.notes:
        print(f"note: {note}")
    for line in found.findings:
        print(line)
    print(f"{found.machine}: {len(found.findings)} findings" + (f"; {page}" if page is not None else ""))


def monitor(
    machine: MachineFile,
    seconds: Annotated[float | None, typer.Option(help="End after so long; else with Ctrl-C.", min=0.1)] = None,
    rate: Annotated[float, typer.Option(help="Pictures a second.", min=0.2, max=20)] = 4.0,
    plain: Annotated[bool, typer.Option("--plain", help="A table after another, also on a terminal.")] = False,
    json: Annotated[bool, typer.Option("--json", help="A line of JSON for each picture.")] = False,
) -> None:
    """Watch values, qualities, ages and devices of a machine as they come."""
    from daq.commissioning.monitor import watch

    watch(load_machine(machine), seconds, rate, plain=plain, json=json)
