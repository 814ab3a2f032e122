"""``hilfit bus scan``: who is on a bus."""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import ValidationError

from daq.commissioning import SCAN_SCHEMA
from daq.console import Json, print_json, show_table
from daq.errors import InputError
from daq.machine.machine_file import CanopenBus, CanSignalsBus, ModbusRtuBus, ModbusSource, ModbusTcpBus, load_machine
from daq.validation_words import in_words

if TYPE_CHECKING:
    from daq.commissioning.can_scan import CanScan
    from daq.commissioning.modbus_scan import ModbusScan

AnyBus = CanopenBus | CanSignalsBus | ModbusTcpBus | ModbusRtuBus


def scan(
    machine: Annotated[
        Path | None, typer.Argument(help="A machine file whose buses are looked at; else say which bus.")
    ] = None,
    bus: Annotated[str | None, typer.Option(help="Only this bus of the machine file.")] = None,
    interface: Annotated[str | None, typer.Option(help="A CAN bus: python-can's interface, as socketcan.")] = None,
    channel: Annotated[str, typer.Option(help="Channel of the CAN interface.")] = "can0",
    bitrate: Annotated[int | None, typer.Option(help="Of the CAN bus, where the interface sets it.")] = None,
    option: Annotated[list[str] | None, typer.Option(help="KEY=VALUE for python-can, several times.")] = None,
    tcp: Annotated[str | None, typer.Option(help="Modbus TCP: HOST or HOST:PORT.")] = None,
    serial: Annotated[str | None, typer.Option(help="Modbus RTU: a serial port.")] = None,
    baudrate: Annotated[int, typer.Option(help="Of the serial port.")] = 115200,
    parity: Annotated[str, typer.Option(help="Of the serial port: N, E or O.")] = "E",
    units: Annotated[str | None, typer.Option(help="Modbus units to ask, as 1-8,12; no others are.")] = None,
    registers: Annotated[str | None, typer.Option(help="Registers to read from units that answer, as 0-20.")] = None,
    nodes: Annotated[str, typer.Option(help="CANopen nodes to ask.")] = "1-127",
    seconds: Annotated[float, typer.Option(help="To listen before anything is sent.", min=0.1)] = 2.0,
    ask: Annotated[
        bool, typer.Option("--ask", help="Ask nodes and units what they are, where nobody else leads the bus.")
    ] = False,
    listen_only: Annotated[bool, typer.Option("--listen-only", help="Send nothing: as without --ask.")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Also write it for 'machine new'.")] = None,
    json: Json = False,
) -> None:
    """List who is on a bus, in two seconds. With --ask it then asks, unless somebody else leads; writes nothing."""
    from daq.commissioning.modbus_scan import scan_modbus, span

    if output is not None and output.suffix != ".json":
        raise InputError("daq.scan_not_json", output=output)
    asked_nodes = span(nodes, "nodes", 1, 127)
    asked_units = None if units is None else span(units, "units", 0, 255)
    read = None if registers is None else span(registers, "registers", 0, 0xFFFF)
    if ask and listen_only:
        raise InputError("daq.scan_asks_and_listens")
    chosen = _described(interface, channel, bitrate, option or (), tcp, serial, baudrate, parity)
    used: dict[str, list[int]] = {}
    if machine is not None:
        chosen, used = _of_machine(machine, bus, chosen)
    if not chosen:
        raise InputError("daq.scan_without_bus")
    results: list[CanScan | ModbusScan] = []
    for one in chosen:
        if isinstance(one, CanopenBus | CanSignalsBus):
            results.append(_of_can(one, seconds, ask, asked_nodes))
            continue
        if listen_only:
            raise InputError("daq.scan_modbus_not_silent", bus=one.name)
        if numbers := asked_units or _units_of(one.name, used, ask):
            results.append(scan_modbus(one, numbers, None if read is None else range(read[0], read[-1] + 1)))
    content = {"schema": SCAN_SCHEMA, "buses": [asdict(result) for result in results]}
    if output is not None:
        output.write_text(json_text.dumps(content, indent=1) + "\n", encoding="utf-8")
    if json:
        print_json(content)
        return
    _print_scans(results)
    if output is not None:
        print(f"{output}: written; next: hilfit machine new --scan {output} -o machine.yaml")


def _units_of(bus: str, used: dict[str, list[int]], ask: bool) -> list[int]:
    """Choose the units of a machine file to ask: none unless requested."""
    if bus not in used:
        raise InputError("daq.scan_without_units", bus=bus)
    if not ask:
        print(f"bus '{bus}': its units are not asked without --ask", file=sys.stderr)
    return used[bus] if ask else []


def _of_can(bus: CanopenBus | CanSignalsBus, seconds: float, ask: bool, nodes: Sequence[int]) -> CanScan:
    """Scan a CAN bus, announcing what will be sent before anything is."""
    from daq.commissioning.can_scan import questions, scan_can

    asking = ask and not bus.listen_only
    if asking:
        print(f"bus '{bus.name}': listens for {seconds:g} s, then sends {questions(nodes)}", file=sys.stderr)
    return scan_can(bus, seconds=seconds, ask=asking, nodes=nodes)


def _described(
    interface: str | None,
    channel: str,
    bitrate: int | None,
    options: Sequence[str],
    tcp: str | None,
    serial: str | None,
    baudrate: int,
    parity: str,
) -> list[AnyBus]:
    """List the buses that the options describe."""
    pairs: dict[str, Any] = {}
    for text in options:
        key, equals, value = text.partition("=")
        if not equals:
            raise InputError("daq.option_no_pair", text=text)
        pairs[key] = int(value) if value.isdigit() else value
    found: list[AnyBus] = []
    try:
        if interface is not None:
            settings = {"interface": interface, "channel": channel, "bitrate": bitrate, "options": pairs}
            found.append(CanopenBus.model_validate({"name": "can", "type": "canopen", **settings}))
        if tcp is not None:
            host, _, port = tcp.rpartition(":") if ":" in tcp else (tcp, "", "502")
            found.append(ModbusTcpBus(name="modbus", type="modbus_tcp", host=host, port=int(port)))
        if serial is not None:
            found.append(
                ModbusRtuBus.model_validate(
                    {"name": "rtu", "type": "modbus_rtu", "port": serial, "baudrate": baudrate, "parity": parity}
                )
            )
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(
            "daq.scan_bus_wrong", key=first["loc"][-1] if first["loc"] else "bus", what=in_words(first)
        ) from None
    except ValueError:
        raise InputError("daq.tcp_no_address", tcp=tcp) from None
    return found


def _of_machine(path: Path, name: str | None, described: list[AnyBus]) -> tuple[list[AnyBus], dict[str, list[int]]]:
    """List buses of a machine file, and the Modbus units that its channels come from."""
    if described:
        raise InputError("daq.scan_two_buses_said")
    machine = load_machine(path)
    chosen = [
        bus
        for bus in machine.buses
        if isinstance(bus, CanopenBus | CanSignalsBus | ModbusTcpBus | ModbusRtuBus) and name in (None, bus.name)
    ]
    if not chosen:
        there = [bus.name for bus in machine.buses]
        if not there:
            raise InputError("daq.scan_no_bus", path=path)
        raise InputError("daq.scan_no_such_bus", path=path, there=there)
    used: dict[str, set[int]] = {}
    for one in machine.channels:
        if isinstance(one.source, ModbusSource):
            used.setdefault(one.source.bus, set()).add(one.source.unit)
    return chosen, {bus: sorted(units) for bus, units in used.items()}


def _print_scans(results: Sequence[CanScan | ModbusScan]) -> None:
    """Print tables for people."""
    from rich.console import Console
    from rich.table import Table

    from daq.commissioning.can_scan import CanScan

    console = Console(soft_wrap=False)
    for result in results:
        name = result.bus["name"]
        if isinstance(result, CanScan):
            how = "then asked" if result.asked else "nothing was sent"
            console.print(f"bus '{name}': listened for {result.seconds:g} s, {how}", highlight=False)
            _print_nodes(console, result)
            table = Table("identifier", "what", "node", "rate, Hz", "jitter, ms", "bytes", "last", box=None)
            for entry in result.heard:
                identifier = f"0x{entry.identifier:08X}" if entry.extended else f"0x{entry.identifier:03X}"
                rate = "" if entry.hz is None else f"{entry.hz:.4g}"
                jitter = "" if entry.jitter_ms is None else f"{entry.jitter_ms:.2f}"
                node = "" if entry.node is None else str(entry.node)
                table.add_row(identifier, entry.what, node, rate, jitter, str(entry.length), entry.data)
            if result.heard:
                show_table(table, console)
        else:
            asked = result.units_asked
            console.print(f"bus '{name}': {len(asked)} units asked, {len(result.units)} answer", highlight=False)
            table = Table("unit", "answer", "took, ms", "identity", box=None)
            for unit in result.units:
                table.add_row(str(unit.unit), unit.answer, f"{unit.milliseconds:.1f}", ", ".join(unit.identity))
            if result.units:
                show_table(table, console)
            for unit in result.units:
                for kind, held in unit.registers.items():
                    words = " ".join(f"{at}:{word:04X}" for at, word in held.items())
                    console.print(f"  unit {unit.unit} {kind} {words}", highlight=False)
        for note in result.notes:
            console.print(note, highlight=False)


def _print_nodes(console: Any, result: CanScan) -> None:
    from rich.table import Table

    if not result.nodes:
        return
    table = Table("node", "state", "device", "serial number", "firmware", "vendor, product", "sends", box=None)
    for node in result.nodes:
        serial = "" if node.serial_number is None else f"0x{node.serial_number:08X}"
        vendor = ", ".join(f"0x{part:08X}" for part in (node.vendor_id, node.product_code) if part is not None)
        sends = "; ".join(
            f"TPDO{pdo.number}: " + ", ".join(f"0x{index:04X}:{sub}/{bits}" for index, sub, bits in pdo.entries)
            for pdo in node.pdos
        )
        device = " ".join(part for part in (node.name, f"[{node.profile}]" if node.profile else "") if part)
        table.add_row(
            str(node.node), node.state, device.replace("[", "\\["), serial, node.firmware or "", vendor, sends
        )
    show_table(table, console)
