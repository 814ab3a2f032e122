"""EDS and DCF files as devices' makers write them: what PDOs carry is found, whatever the habits of the file.

The dictionaries are made here, from what sensors of the profiles map by default and from habits that files in use have
(order, case, blanks, alphabets, what CiA 306 allows to leave out and what it does not); none is anybody's file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daq import MachineFileError
from daq.commissioning.offers import of_eds
from daq.drivers.canopen.eds import pdo_places

NODE = 0x15
Lines = list[str]


@dataclass(frozen=True)
class Device:
    """What a device is by default: device type, and per TPDO number, transmission, event timer, mapping entries."""

    name: str
    device_type: int
    tpdos: tuple[tuple[int, int, int, tuple[int, ...]], ...]


def tpdo(number: int, transmission: int, event_ms: int, *entries: int) -> tuple[int, int, int, tuple[int, ...]]:
    return number, transmission, event_ms, entries


ENCODER = Device("absolute encoder", 0x00020196, (tpdo(1, 254, 0, 0x60040020), tpdo(2, 1, 0, 0x60040020, 0x60300110)))
MULTITURN = Device("multiturn encoder", 0x00020196, (tpdo(1, 255, 100, 0x60040020), tpdo(2, 1, 0, 0x60040020)))
UMLAUTS = Device("Drehgeber für Höhe, ±1°", 0x00020196, MULTITURN.tpdos)
LINEAR = Device("linear encoder", 0x000A0196, (tpdo(1, 254, 50, 0x60200120), tpdo(2, 1, 0, 0x60200120, 0x60300110)))
TWO_HEADS = Device("linear encoder of two magnets", 0x000A0196, (tpdo(1, 1, 0, 0x60200120, 0x60200220),))
PRESSURE = Device("pressure transmitter", 0x00020194, (tpdo(1, 255, 0, 0x61300120, 0x61500108),))
PRESSURE_16 = Device("pressure transmitter, 16 bits", 0x00020194, (tpdo(1, 1, 0, 0x71300110, 0x61500108),))
TWO_CHANNELS = Device("pressure and temperature", 0x00020194, (tpdo(1, 1, 0, 0x61300120, 0x61300220),))
TILT = Device("inclinometer", 0x0004019A, (tpdo(1, 255, 50, 0x60100010, 0x60200010),))
TILT_32 = Device("inclinometer, 32 bits", 0x0004019A, (tpdo(1, 1, 0, 0x61100020, 0x61200020),))
INPUTS = Device("input module", 0x00050191, (tpdo(1, 255, 0, 0x60000108, 0x60000208), tpdo(2, 1, 0, 0x64010110)))
JOYSTICK = Device(
    "joystick", 0x00060191, (tpdo(1, 255, 20, 0x60000108, 0x64000108, 0x64000208), tpdo(3, 1, 0, 0x64010110))
)
PACKED = Device("packed bits", 0x00020194, (tpdo(4, 1, 0, 0x61500104, 0x61500204, 0x7130010C, 0x71300214),))


def value(number: int) -> str:
    return f"0x{number:X}"


def cob_id(number: int) -> str:
    return f"$NODEID+0x{0x080 + 0x100 * number:X}"


def objects(
    device: Device,
    number: Callable[[int], str] = value,
    of_pdo: Callable[[int], str] = cob_id,
    sub: str = "sub{0:x}",
    name: str = "ParameterName={0}",
) -> list[tuple[str, Lines]]:
    """Sections of a file as CiA 306 has them, in its order."""

    def variable(what: str, kind: int, default: str) -> Lines:
        text = [name.format(what), "ObjectType=0x7", f"DataType=0x{kind:04X}", "AccessType=rw", "PDOMapping=0"]
        return [*(line for line in text if line), f"DefaultValue={default}"]

    found = [
        ("FileInfo", ["FileName=device.eds", "FileVersion=1", "EDSVersion=4.0", "Description="]),
        ("DeviceInfo", ["VendorName=Somebody", "VendorNumber=0x2A", f"ProductName={device.name}", "Granularity=8"]),
        ("DummyUsage", [f"Dummy{k:04X}={int(k > 1)}" for k in range(1, 8)]),
        ("MandatoryObjects", ["SupportedObjects=1", "1=0x1000"]),
        ("1000", variable("Device type", 7, number(device.device_type))),
    ]
    for index, transmission, event_ms, entries in device.tpdos:
        for first, members in (
            (
                0x17FF,
                [(0, 5, number(5)), (1, 7, of_pdo(index)), (2, 5, number(transmission)), (5, 6, number(event_ms))],
            ),
            (0x19FF, [(k, 7 if k else 5, number(e)) for k, e in enumerate((len(entries), *entries))]),
        ):
            section = f"{first + index:04X}"
            head = [name.format("TPDO"), f"ObjectType=0x{9 if first == 0x17FF else 8}", f"SubNumber={len(members)}"]
            found.append((section, [line for line in head if line]))
            found += [(section + sub.format(k), variable(f"entry {k}", kind, told)) for k, kind, told in members]
    kinds = {0x10: 3, 0x20: 4, 0x08: 5, 0x18: 0x10}
    for entry in dict.fromkeys(entry for _, _, _, entries in device.tpdos for entry in entries):
        index, k, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        kind = 8 if index == 0x6130 else kinds.get(bits, 6)
        if not k:
            found.append((f"{index:04X}", variable("value", kind, number(0))))
            continue
        if f"{index:04X}" not in dict(found):
            found.append(
                (f"{index:04X}", [line for line in (name.format("values"), "ObjectType=0x8", "SubNumber=3") if line])
            )
        found.append((f"{index:04X}" + sub.format(k), variable(f"value {k}", kind, number(0))))
    return found


def text(sections: Sequence[tuple[str, Lines]], end: str = "\n", equals: str = "=", before: str = "") -> bytes:
    lines = [before] if before else []
    for section, content in sections:
        lines += [f"[{section}]", *(line.replace("=", equals, 1) for line in content), ""]
    return end.join(lines).encode("utf-8")


def compact(device: Device) -> list[tuple[str, Lines]]:
    """A DCF that lists the mapping in one section (CiA 306, 4.6.3.2), values in ParameterValue."""
    sections = [(s, lines) for s, lines in objects(device) if not s.startswith("1A0")]
    for index, _, _, entries in device.tpdos:
        section = f"{0x19FF + index:04X}"
        head = ["ParameterName=mapping", "ObjectType=0x8", "DataType=0x0007", "AccessType=rw", "PDOMapping=0"]
        sections.append((section, [*head, f"CompactSubObj={len(entries)}"]))
        told = [f"{k}=0x{entry:08X}" for k, entry in enumerate(entries, start=1)]
        sections.append((section + "Value", [f"NrOfEntries={len(entries)}", *told]))
    return sections


def spaced(number: int) -> str:
    return f"$NODEID + 0x{0x080 + 0x100 * number:X}"


def lowered(sections: list[tuple[str, Lines]]) -> list[tuple[str, Lines]]:
    return [(name.lower() if name[0].isdigit() else name, lines) for name, lines in sections]


def changed(device: Device, change: Callable[[Lines], Lines]) -> list[tuple[str, Lines]]:
    return [(name, change(lines)) for name, lines in objects(device)]


def without(device: Device, *keys: str) -> list[tuple[str, Lines]]:
    return [(s, [line for line in lines if not line.startswith(keys)]) for s, lines in objects(device)]


#: Device, habits in words, and the file.
FILES: tuple[tuple[Device, str, bytes], ...] = (
    (ENCODER, "as the standard has it", text(objects(ENCODER))),
    (ENCODER, "CRLF", text(objects(ENCODER), end="\r\n")),
    (MULTITURN, "a byte order mark", b"\xef\xbb\xbf" + text(objects(MULTITURN))),
    (MULTITURN, "Latin-1", text(objects(UMLAUTS)).decode().encode("cp1252")),
    (LINEAR, "node-ID behind the number", text(objects(LINEAR, of_pdo=lambda n: f"0x{0x80 + 0x100 * n:x}+$NODEID"))),
    (LINEAR, "blanks around signs", text(objects(LINEAR, of_pdo=spaced), equals=" = ")),
    (TWO_HEADS, "lower case", text(lowered(objects(TWO_HEADS, of_pdo=lambda n: cob_id(n).lower())))),
    (TWO_HEADS, "SUB in capitals", text(objects(TWO_HEADS, sub="SUB{0:X}"))),
    (PRESSURE, "decimal numbers", text(objects(PRESSURE, number=str))),
    (PRESSURE, "no remote frames", text(objects(PRESSURE, of_pdo=lambda n: f"$NODEID+0x{0x40000080 + 0x100 * n:X}"))),
    (PRESSURE_16, "fixed COB-IDs", text(objects(PRESSURE_16, of_pdo=lambda n: f"0x{0x80 + 0x100 * n + NODE:08X}"))),
    (PRESSURE_16, "no names", text(objects(PRESSURE_16, name=""))),
    (TWO_CHANNELS, "no object types", text(without(TWO_CHANNELS, "ObjectType=0x7"))),
    (TWO_CHANNELS, "no numbers of members", text(without(TWO_CHANNELS, "SubNumber"))),
    (TILT, "comments", text(objects(TILT), before="; made by an editor\n# and by hand")),
    (TILT, "comments behind values", text(changed(TILT, lambda lines: [f"{line} ; as delivered" for line in lines]))),
    (TILT_32, "a section twice", text([*objects(TILT_32), ("DummyUsage", ["Dummy0001=0"])])),
    (TILT_32, "a key twice", text(changed(TILT_32, lambda lines: [*lines, *lines[-1:]]))),
    (INPUTS, "the order turned round", text(objects(INPUTS)[::-1])),
    (INPUTS, "per cent in a name", text(objects(INPUTS, name="ParameterName={0} in 0.1 % of %s"))),
    (JOYSTICK, "compact lists", text(compact(JOYSTICK))),
    (JOYSTICK, "zeros before members", text(objects(JOYSTICK, sub="sub{0:02X}"))),
    (PACKED, "leading blanks", text(changed(PACKED, lambda lines: [f"  {line}" for line in lines]))),
    (PACKED, "empty values, lone keys", text(changed(PACKED, lambda lines: [*lines, "LowLimit=", "Denotation"]))),
)  # fmt: skip


def expected(device: Device) -> dict[tuple[int, int], tuple[int, int, int, bool, int]]:
    """Where each object is first: COB-ID, bit, bits, whether it is sampled at SYNC, event timer."""
    found: dict[tuple[int, int], tuple[int, int, int, bool, int]] = {}
    for number, transmission, event_ms, entries in device.tpdos:
        bit = 0
        for entry in entries:
            synchronous = transmission <= 240
            place = (0x080 + 0x100 * number + NODE, bit, entry & 0xFF, synchronous, 0 if synchronous else event_ms)
            found.setdefault((entry >> 16, entry >> 8 & 0xFF), place)
            bit += entry & 0xFF
    return found


def test_there_are_twenty_dictionaries() -> None:
    assert len(FILES) >= 20 and len({habit for _, habit, _ in FILES}) == len(FILES)


@pytest.mark.parametrize(
    ("device", "content"), [(d, c) for d, _, c in FILES], ids=[f"{d.name}: {h}" for d, h, _ in FILES]
)
def test_what_pdos_carry_is_found_in_every_file(tmp_path: Path, device: Device, content: bytes) -> None:
    path = tmp_path / "device.eds"
    path.write_bytes(content)
    places = pdo_places(str(path), NODE, "can0")
    found = {key: (p.cob_id, p.bit, p.bits, p.synchronous, p.event_ms) for key, p in places.items()}
    assert found == expected(device)
    offered = {(o.source["object"], o.source.get("subindex", 0)) for o in of_eds("can0", NODE, str(path), True)}
    assert offered >= {key for key, place in found.items() if place[2] in (8, 16, 32)}


@given(file=st.sampled_from([content for _, _, content in FILES]), cut=st.floats(0.0, 1.0), other=st.binary(max_size=3))
@settings(max_examples=60, deadline=None)
def test_a_damaged_file_is_refused_in_a_line_or_says_less(
    tmp_path_factory: pytest.TempPathFactory, file: bytes, cut: float, other: bytes
) -> None:
    path = tmp_path_factory.mktemp("eds") / "device.eds"
    at = round(cut * len(file))
    path.write_bytes(file[:at] + other + file[at + len(other) :] if other else file[:at])
    try:
        pdo_places(str(path), NODE, "can0")
    except MachineFileError as error:
        assert "\n" not in str(error) and "device.eds" in str(error)
