"""Commissioning of one CANopen node: from any state to sending its TPDOs on SYNC, with everything read back.

It is put back to what it was before, too (:mod:`daq.drivers.found_setups`).

The order is the one that makes every later step safe: the listeners are there before the first command, the node is
stopped from sending before its mapping changes, it is identified before anything is written to it, and what was
written is read back before it goes operational.
"""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from daq.drivers import wire
from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.canopen.leadership import Leadership
from daq.drivers.canopen.link import CanLink, NoAnswerError, Sdo, SdoRefusedError, WrongAnswerError
from daq.drivers.canopen.mapping import TPDO_COUNT, Mapping
from daq.drivers.found_setups import FoundSetup, FoundSetups, Objects
from daq.errors import AcquisitionError, BusError, CommissioningError
from daq.machine.buses import object_of
from daq.machine.machine_file import CanNode, CanopenBus, CanSource, Machine
from daq.messages import Sentence

OPERATIONAL = 0x01  # NMT commands (CiA 301, 7.3.2.2.1)
PRE_OPERATIONAL = 0x80
STOPPED = 0x02
#: NMT command that brings a node back to the state that its heartbeat showed; pre-operational where it had none.
LEFT: dict[int | None, int] = {0x05: OPERATIONAL, 0x04: STOPPED}
PDO_NOT_VALID = 0x8000_0000
_NO_REMOTE = 0x4000_0000
#: Seconds that a second device of one node-ID may take longer for its answer, waited for before the node is started.
SECOND_ANSWER_S = 0.05
SYNCHRONOUS_EVERY = 1  # transmission type: at every SYNC


def commission(
    sdo: Sdo,
    send_nmt: Callable[[int], None],
    node: CanNode,
    mappings: Sequence[Mapping],
    place: str,
    *,
    monotonic_ns: Callable[[], int],
    answered: Callable[[], None],
    boot_up_s: float,
    keep: Callable[[Objects, Objects, Objects], None] = lambda found, wrote, identity: None,
    learn: Callable[[Sdo], None] = lambda sdo: None,
) -> None:
    """Commission one node; it is operational afterwards and sends every mapped TPDO at every SYNC.

    What already is as it has to be is not written.

    Parameters
    ----------
    sdo : access to the node
    send_nmt : sends an NMT command to this node
    node : what it has to be, and its settings
    mappings : its TPDOs
    place : how errors call the node
    answered : called when it has answered for the first time: a boot-up after that means that all is to do again
    boot_up_s : how long it may take to answer at first
    learn : called before it is operational, to read what else has to be known of it, as its heartbeat time
    keep : called before the first object is written, with objects as they are, as they will be, and its identity

    Raises
    ------
    CommissioningError
        If it does not answer, is another device, refuses something, or keeps other values than were written.
    """
    send_nmt(PRE_OPERATIONAL)
    device_type = _await_answer(sdo, place, monotonic_ns, boot_up_s)
    answered()
    _alone(sdo, place)
    _identify(sdo, node, place, device_type)
    found = _present(sdo, node, mappings)
    wanted = _wanted(sdo, node, mappings, found)
    changed = {key for key, value in wanted.items() if found.get(key) != value}
    pdos = {_pdo(key) for key in changed} - {None}
    if changed:
        _alone(sdo, place)
        keep(found, wanted, _identity_of(sdo))
        _write_objects(sdo, {k: v for k, v in wanted.items() if k in changed or _pdo(k) in pdos}, place)
    _alone(sdo, place, SECOND_ANSWER_S)
    learn(sdo)
    send_nmt(OPERATIONAL)


def _await_answer(sdo: Sdo, place: str, monotonic_ns: Callable[[], int], boot_up_s: float) -> int:
    deadline = monotonic_ns() + round(boot_up_s * 1e9)
    while True:
        try:
            return sdo.read_unsigned(0x1000)
        except NoAnswerError as error:
            if monotonic_ns() >= deadline:
                if isinstance(error, WrongAnswerError):
                    raise
                within = Sentence("daq.within_boot_up", boot_up_s=boot_up_s) if boot_up_s else ""
                raise NoAnswerError("daq.does_not_answer", place=place, within=within) from None


def _alone(sdo: Sdo, place: str, wait_s: float = 0.0) -> None:
    """Check that no two devices answer with one node-ID, before anything is written for the first time."""
    sdo.read_unsigned(0x1000)  # by now the second answer to the first request has come, as a rule
    if not sdo.surplus:
        time.sleep(wait_s)
    if sdo.surplus:
        raise CommissioningError("daq.two_devices_one_node", place=place)


def _identify(sdo: Sdo, node: CanNode, place: str, device_type: int) -> None:
    for what, key, expected, subindex in (
        ("device type (0x1000)", "device_type", node.device_type, None),
        ("vendor-ID (0x1018:1)", "vendor_id", node.vendor_id, 1),
        ("product code (0x1018:2)", "product_code", node.product_code, 2),
        ("revision (0x1018:3)", "revision_number", node.revision_number, 3),
        ("serial number (0x1018:4)", "serial_number", node.serial_number, 4),
    ):
        if expected is None:
            continue
        found = device_type if subindex is None else sdo.read_unsigned(0x1018, subindex)
        if found != expected:
            raise CommissioningError(
                "daq.another_device", place=place, what=what, found=f"{found:08X}", expected=f"{expected:08X}", key=key
            )
    if node.firmware is not None:
        version = sdo.read(0x100A).rstrip(b"\0 ").decode("latin-1")
        if version != node.firmware:
            raise CommissioningError("daq.firmware_differs", place=place, version=version[:40], firmware=node.firmware)


def _identity_of(sdo: Sdo) -> dict[tuple[int, int], bytes]:
    """Read device type, vendor, product, revision and serial number, as far as the node has them."""
    return _read_there(sdo, [(0x1000, 0), *((0x1018, subindex) for subindex in range(1, 5))])


def _read_there(sdo: Sdo, keys: Iterable[tuple[int, int]]) -> dict[tuple[int, int], bytes]:
    """Read objects that the node has."""
    found = {}
    for index, subindex in keys:
        with contextlib.suppress(SdoRefusedError):
            found[index, subindex] = sdo.read(index, subindex)
    return found


def _present(sdo: Sdo, node: CanNode, mappings: Sequence[Mapping]) -> dict[tuple[int, int], bytes]:
    """Read everything that commissioning may write."""
    needed = {mapping.number for mapping in mappings}
    found: dict[tuple[int, int], bytes] = {}
    for number in range(1, TPDO_COUNT + 1):
        parameters, objects = 0x1800 + number - 1, 0x1A00 + number - 1
        found |= _read_there(sdo, [(parameters, 1)])
        if number in needed:
            found |= _read_there(sdo, [(parameters, 2), (objects, 0)])
            count = int.from_bytes(found.get((objects, 0), b"\0"), "little")
            found |= _read_there(sdo, [(objects, entry) for entry in range(1, min(count, 8) + 1)])
    settings = [_object(key)[:2] for key in node.settings]
    return found | _read_there(sdo, [(0x1017, 0), *settings])


def _wanted(sdo: Sdo, node: CanNode, mappings: Sequence[Mapping], found: Objects) -> dict[tuple[int, int], bytes]:
    """Return the same objects, as they have to be."""
    wanted: dict[tuple[int, int], bytes] = {}
    needed = {mapping.number: mapping for mapping in mappings}
    for number in range(1, TPDO_COUNT + 1):
        parameters, objects = 0x1800 + number - 1, 0x1A00 + number - 1
        present = int.from_bytes(found.get((parameters, 1), b""), "little")
        mapping = needed.get(number)
        if mapping is None:
            if (parameters, 1) in found:
                wanted[parameters, 1] = struct.pack("<I", present | PDO_NOT_VALID)
            continue
        same = present & ~_NO_REMOTE == mapping.cob_id  # a device may insist on "no remote frames"
        wanted[parameters, 1] = struct.pack("<I", present if same else mapping.cob_id)
        wanted[parameters, 2] = bytes((SYNCHRONOUS_EVERY,))
        wanted[objects, 0] = bytes((len(mapping.entries),))
        for subindex, entry in enumerate(mapping.entries, start=1):
            wanted[objects, subindex] = struct.pack("<I", entry)
    if (0x1017, 0) in found:  # else it sends none
        wanted[0x1017, 0] = struct.pack("<H", node.heartbeat_ms)
    for key, value in node.settings.items():
        index, subindex, data_type = _object(key)
        wanted[index, subindex] = _encode(sdo, index, subindex, data_type, value)
    return wanted


def _pdo(key: tuple[int, int]) -> int | None:
    """Return the number (from 0) of the TPDO that an object belongs to."""
    return key[0] & 0x1FF if 0x1800 <= key[0] < 0x1C00 else None


def _write_objects(sdo: Sdo, objects: Objects, place: str) -> None:
    """Write objects in the order that is safe, and read them back.

    A TPDO is off while its mapping changes (CiA 301, 7.5.2.36): mapping is changed with the number of entries at 0, is
    valid when that is written again, and the COB-ID comes last.

    Raises
    ------
    CommissioningError
        If the node refuses one, or keeps another value.
    """
    pdos = sorted({number for key in objects if (number := _pdo(key)) is not None})
    for number in pdos:
        present = sdo.read_unsigned(0x1800 + number, 1)
        if not present & PDO_NOT_VALID:
            sdo.write(0x1800 + number, 1, struct.pack("<I", present | PDO_NOT_VALID))
    for number in pdos:
        _write_pdo(sdo, 0x1800 + number, 0x1A00 + number, objects)
    for (index, subindex), data in objects.items():
        if _pdo((index, subindex)) is None:
            sdo.write(index, subindex, data)
    for (index, subindex), data in objects.items():
        _read_back(sdo, index, subindex, data, place)


def _write_pdo(sdo: Sdo, parameters: int, mapping: int, objects: Objects) -> None:
    count = objects.get((mapping, 0))
    if count is not None:
        sdo.write(mapping, 0, b"\x00")
        for entry in range(1, int.from_bytes(count, "little") + 1):
            if (mapping, entry) in objects:
                sdo.write(mapping, entry, objects[mapping, entry])
        sdo.write(mapping, 0, count)
    if (parameters, 2) in objects:
        sdo.write(parameters, 2, objects[parameters, 2])
    cob_id = objects.get((parameters, 1))
    if cob_id is not None and not int.from_bytes(cob_id, "little") & PDO_NOT_VALID:
        sdo.write(parameters, 1, cob_id)


def _read_back(sdo: Sdo, index: int, subindex: int, data: bytes, place: str) -> None:
    found = sdo.read(index, subindex)[: len(data)]
    if found == data:
        return
    if index == 0x1017 and any(found):  # in steps of its own; the watchdog goes by what it says
        return
    is_pdo = _pdo((index, subindex)) is not None
    if is_pdo and subindex == 1 and index < 0x1A00:
        differs = int.from_bytes(found, "little") ^ int.from_bytes(data, "little")
        if not differs & ~_NO_REMOTE:
            return
    advice = "its mapping may be fixed: see its manual" if is_pdo else "see its manual for the values it takes"
    raise CommissioningError(
        "daq.keeps_although_written",
        place=place,
        found=f"{int.from_bytes(found, 'little'):X}",
        index=f"{index:04X}",
        subindex=f"{subindex:02X}",
        data=f"{int.from_bytes(data, 'little'):X}",
        advice=advice,
    )


def _object(key: str) -> tuple[int, int, str | None]:
    """Parse index, subindex and, if given, data type of a settings key like ``0x6131:1 uint32``."""
    place, _, data_type = key.partition(" ")
    return *object_of(place), data_type.strip() or None


def _encode(sdo: Sdo, index: int, subindex: int, data_type: str | None, value: float) -> bytes:
    """Encode the value in the object's data type: the declared one, else an integer of the node's present size."""
    if data_type is not None:
        return wire.encode(data_type, value)
    size = len(sdo.read(index, subindex))
    if value != round(value):
        return wire.encode("float64" if size == 8 else "float32", value)
    return int(value).to_bytes(size, "little", signed=value < 0)


@dataclass(frozen=True)
class Restored:
    """One node, and the line that says why it was not put back (empty if it was)."""

    bus: str
    node: int
    failure: str = ""


def restore_nodes(machine: Machine, data_directory: Path) -> list[Restored]:
    """Put back what commissioning changed in the nodes of a machine; nobody may be acquiring from it.

    Raises
    ------
    BusError
        If a bus cannot be opened, or another master leads it; nothing was sent on that one then.
    """
    kept = FoundSetups(data_directory, machine.name)
    done = []
    for bus in machine.buses:
        if not isinstance(bus, CanopenBus) or bus.listen_only:
            continue
        nodes = sorted(
            {c.source.node for c in machine.channels if isinstance(c.source, CanSource) and c.source.bus == bus.name}
        )
        setups = {node: setup for node in nodes if (setup := kept.read(bus.name, node)) is not None}
        if setups:
            done += _bus(bus, setups, kept)
    return done


def _bus(bus: CanopenBus, setups: dict[int, FoundSetup], kept: FoundSetups) -> list[Restored]:
    context = DriverContext(1.0, 0.0, time.monotonic_ns)
    leadership = Leadership(bus, context, setups, kept.started(bus.name))
    link = CanLink(bus, context, BusHealth(), leadership)
    try:
        if not link.leadership.lead():
            raise BusError("daq.led_nothing_sent", bus=bus.name, leadership=link.leadership.masters_seen())
        done = []
        for node, setup in setups.items():
            link.send_nmt(PRE_OPERATIONAL, node)
            try:
                sdo, place = link.sdo(node), Sentence("daq.bus_node", bus_name=bus.name, node=node)
                if _identity_of(sdo) != dict(setup.identity):
                    raise CommissioningError("daq.not_the_changed_device", place=place)
                _write_objects(sdo, setup.found, place)
            except AcquisitionError as error:
                done.append(Restored(bus.name, node, str(error)))
                continue
            link.send_nmt(LEFT.get(setup.state, PRE_OPERATIONAL), node)
            kept.put_back(bus.name, node)
            done.append(Restored(bus.name, node))
        return done
    finally:
        link.close()
