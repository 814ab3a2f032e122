"""Which object of a node goes into which TPDO: derived from the channels' sources, nothing is configured by hand.

A TPDO carries 8 bytes; a node has four of them in the predefined connection set (CiA 301, 7.3.5)::

    TPDO n    COB-ID 0x180 + 0x100 (n - 1) + node    parameters 0x1800 + n - 1    mapping 0x1A00 + n - 1
    mapping entry    index << 16 | subindex << 8 | bits
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from daq.arrays import FloatArray
from daq.drivers import wire
from daq.errors import MachineFileError
from daq.machine.machine_file import CanSource, Channel

TPDO_BYTES = 8
TPDO_COUNT = 4


def laid_out(entries: Iterable[int]) -> Iterator[tuple[int, int, int, int]]:
    """Lay out mapping entries in a PDO, one behind the other: index, subindex, first bit and bits."""
    bit = 0
    for entry in entries:
        yield entry >> 16, entry >> 8 & 0xFF, bit, entry & 0xFF
        bit += entry & 0xFF


class PdoDecoder:
    """Unpacks numbers of these data types, one behind the other, little endian."""

    def __init__(self, data_types: Sequence[str]) -> None:
        self.data_types = tuple(data_types)
        codes = [wire.struct_code(kind) for kind in data_types]
        self._struct = struct.Struct("<" + "".join(codes))
        self._wide = any(kind.endswith("24") for kind in data_types)
        self._alike = np.dtype("<" + codes[0]) if len(set(codes)) == 1 and not self._wide else None

    def unpack(self, data: bytes) -> tuple[float, ...]:
        """Unpack the numbers in as many bytes as they take."""
        found: tuple[float, ...] = self._struct.unpack(data)
        if not self._wide:
            return found
        return tuple(wire.number(kind, value) for kind, value in zip(self.data_types, found, strict=True))

    def array(self, data: bytes) -> FloatArray:
        """Unpack into an array: at once where all are of one type, as nearly always."""
        if self._alike is None:
            return np.array(self.unpack(data), dtype=np.float64)
        return np.frombuffer(data, self._alike).astype(np.float64)


@dataclass(frozen=True)
class Mapping:
    """One TPDO of a node.

    Attributes
    ----------
    number : 1 to 4
    cob_id : its COB-ID
    entries : mapping entries, in order
    length : bytes of data
    decoder : unpacks the data
    positions : for every entry, the channels (positions in the driver's order) that it feeds
    """

    number: int
    cob_id: int
    entries: tuple[int, ...]
    length: int
    decoder: PdoDecoder
    positions: tuple[tuple[int, ...], ...]


def map_node(node: int, channels: Sequence[tuple[int, Channel]], place: str) -> tuple[Mapping, ...]:
    """Pack the objects of one node into TPDOs, first fit, in the order of the channels.

    Parameters
    ----------
    channels : position in the driver's order, and the channel
    place : how errors call the node

    Raises
    ------
    MachineFileError
        If the objects do not fit four TPDOs, or one object is declared with two data types.
    """
    objects: dict[tuple[int, int], tuple[str, list[int]]] = {}
    for position, channel in channels:
        source = channel.source
        assert isinstance(source, CanSource)
        key = (source.object, source.subindex)
        data_type, positions = objects.setdefault(key, (source.data_type, []))
        if data_type != source.data_type:
            raise MachineFileError(
                "daq.object_two_types",
                place=place,
                index=f"{key[0]:04X}",
                subindex=key[1],
                one=data_type,
                other=source.data_type,
                channel=channel.name,
            )
        positions.append(position)
    pdos: list[list[tuple[tuple[int, int], str, list[int]]]] = [[] for _ in range(TPDO_COUNT)]
    for key, (data_type, positions) in objects.items():
        for pdo in pdos:
            if sum(wire.size(kind) for _, kind, _ in pdo) + wire.size(data_type) <= TPDO_BYTES:
                pdo.append((key, data_type, positions))
                break
        else:
            raise MachineFileError(
                "daq.objects_do_not_fit", place=place, count=len(objects), tpdo_count=TPDO_COUNT, tpdo_bytes=TPDO_BYTES
            )
    return tuple(
        Mapping(
            number=number,
            cob_id=0x180 + 0x100 * (number - 1) + node,
            entries=tuple(key[0] << 16 | key[1] << 8 | 8 * wire.size(kind) for key, kind, _ in pdo),
            length=sum(wire.size(kind) for _, kind, _ in pdo),
            decoder=PdoDecoder([kind for _, kind, _ in pdo]),
            positions=tuple(tuple(positions) for _, _, positions in pdo),
        )
        for number, pdo in enumerate(pdos, start=1)
        if pdo
    )
