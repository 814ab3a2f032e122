"""Commissioning of one CANopen node: from any state to sending its TPDOs on SYNC, with everything read back.

The order is the one that makes every later step safe: the listeners are there before the first command, the node is
stopped from sending before its mapping changes, it is identified before anything is written to it, and what was
written is read back before it goes operational.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Protocol

from daq import wire
from daq.drivers.canopen_link import NoAnswerError, SdoRefusedError
from daq.drivers.canopen_mapping import TPDO_COUNT, Mapping
from daq.errors import CommissioningError
from daq.machine_file import CanNode

OPERATIONAL = 0x01  # NMT commands (CiA 301, 7.3.2.2.1)
PRE_OPERATIONAL = 0x80
PDO_NOT_VALID = 0x8000_0000
SYNCHRONOUS_EVERY = 1  # transmission type: at every SYNC


class SdoAccess(Protocol):
    """Reads and writes objects of one node."""

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Bytes of an object."""

    def read_unsigned(self, index: int, subindex: int = 0) -> int:
        """An unsigned object."""

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object."""

    @property
    def surplus(self) -> int:
        """Answers beyond one per request so far."""


def commission(
    sdo: SdoAccess,
    send_nmt: Callable[[int], None],
    node: CanNode,
    mappings: Sequence[Mapping],
    place: str,
    *,
    monotonic_ns: Callable[[], int],
    answered: Callable[[], None],
    boot_up_s: float,
) -> None:
    """Commission one node; it is operational afterwards and sends every mapped TPDO at every SYNC.

    Parameters
    ----------
    sdo : access to the node
    send_nmt : sends an NMT command to this node
    node : what it has to be, and its settings
    mappings : its TPDOs
    place : how errors call the node
    answered : called when it has answered for the first time: a boot-up after that means that all is to do again
    boot_up_s : how long it may take to answer at first

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
    _pdos_off(sdo, mappings)
    for mapping in mappings:
        _map(sdo, mapping)
    for mapping in mappings:
        _read_back(sdo, mapping, place)
    _write_checked(sdo, 0x1017, 0, struct.pack("<H", node.heartbeat_ms), place)
    for key, value in node.settings.items():
        index, subindex, data_type = _object(key)
        _write_checked(sdo, index, subindex, _encode(sdo, index, subindex, data_type, value), place)
    _alone(sdo, place)
    send_nmt(OPERATIONAL)


def _await_answer(sdo: SdoAccess, place: str, monotonic_ns: Callable[[], int], boot_up_s: float) -> int:
    deadline = monotonic_ns() + round(boot_up_s * 1e9)
    while True:
        try:
            return sdo.read_unsigned(0x1000)
        except NoAnswerError as error:
            if monotonic_ns() >= deadline:
                if "does not answer" not in str(error):
                    raise
                raise NoAnswerError(
                    f"{place}: does not answer within {boot_up_s:g} s; check its power, node-ID, bitrate and cable"
                ) from None


def _alone(sdo: SdoAccess, place: str) -> None:
    """Two devices with one node-ID both answer; nothing is written before this was asked for the first time."""
    sdo.read_unsigned(0x1000)  # by now the second answer to the first request has come
    if sdo.surplus:
        raise CommissioningError(
            f"{place}: two devices answer with this node-ID; give each one of its own, and connect them again"
        )


def _identify(sdo: SdoAccess, node: CanNode, place: str, device_type: int) -> None:
    for what, key, expected, subindex in (
        ("device type (0x1000)", "device_type", node.device_type, None),
        ("vendor-ID (0x1018:1)", "vendor_id", node.vendor_id, 1),
        ("product code (0x1018:2)", "product_code", node.product_code, 2),
    ):
        if expected is None:
            continue
        found = device_type if subindex is None else sdo.read_unsigned(0x1018, subindex)
        if found != expected:
            raise CommissioningError(
                f"{place}: is another device: {what} is 0x{found:08X}, the machine file says 0x{expected:08X}; "
                f"connect the right one or correct {key}"
            )


def _pdos_off(sdo: SdoAccess, mappings: Sequence[Mapping]) -> None:
    needed = {mapping.number for mapping in mappings}
    for number in range(1, TPDO_COUNT + 1):
        try:
            cob_id = sdo.read_unsigned(0x1800 + number - 1, 1)
            if not cob_id & PDO_NOT_VALID:
                sdo.write(0x1800 + number - 1, 1, struct.pack("<I", cob_id | PDO_NOT_VALID))
        except SdoRefusedError:
            if number in needed:
                raise


def _map(sdo: SdoAccess, mapping: Mapping) -> None:
    parameters, objects = 0x1800 + mapping.number - 1, 0x1A00 + mapping.number - 1
    # CiA 301, 7.5.2.36: mapping is changed with the number of entries at 0, and is valid when it is written again.
    sdo.write(objects, 0, b"\x00")
    for subindex, entry in enumerate(mapping.entries, start=1):
        sdo.write(objects, subindex, struct.pack("<I", entry))
    sdo.write(objects, 0, bytes((len(mapping.entries),)))
    sdo.write(parameters, 2, bytes((SYNCHRONOUS_EVERY,)))
    sdo.write(parameters, 1, struct.pack("<I", mapping.cob_id))


def _read_back(sdo: SdoAccess, mapping: Mapping, place: str) -> None:
    parameters, objects = 0x1800 + mapping.number - 1, 0x1A00 + mapping.number - 1
    expected = [
        (parameters, 1, mapping.cob_id),
        (parameters, 2, SYNCHRONOUS_EVERY),
        (objects, 0, len(mapping.entries)),
    ]
    expected += [(objects, subindex, entry) for subindex, entry in enumerate(mapping.entries, start=1)]
    for index, subindex, value in expected:
        found = sdo.read_unsigned(index, subindex)
        if (index, subindex) == (parameters, 1):
            found &= ~0x4000_0000  # "no remote frames", which a device may insist on
        if found != value:
            raise CommissioningError(
                f"{place}: keeps 0x{found:X} in 0x{index:04X}:{subindex:02X} although 0x{value:X} was "
                "written; its mapping "
                "may be fixed: see its manual"
            )


def _write_checked(sdo: SdoAccess, index: int, subindex: int, data: bytes, place: str) -> None:
    sdo.write(index, subindex, data)
    found = sdo.read(index, subindex)[: len(data)]
    if found != data:
        raise CommissioningError(
            f"{place}: keeps 0x{found[::-1].hex()} in 0x{index:04X}:{subindex:02X} although "
            f"0x{data[::-1].hex()} was written; "
            "see its manual for the values it takes"
        )


def _object(key: str) -> tuple[int, int, str | None]:
    """Index, subindex and, if it is given, data type of a settings key like ``0x6131:1 uint32``."""
    place, _, data_type = key.partition(" ")
    index, _, subindex = place.partition(":")
    return int(index, 0), int(subindex or "0", 0), data_type.strip() or None


def _encode(sdo: SdoAccess, index: int, subindex: int, data_type: str | None, value: float) -> bytes:
    """The value in the object's data type: the declared one, else an integer of the size that the node holds now."""
    if data_type is not None:
        return wire.encode(data_type, value)
    size = len(sdo.read(index, subindex))
    if value != round(value):
        return wire.encode("float64" if size == 8 else "float32", value)
    return int(value).to_bytes(size, "little", signed=value < 0)
