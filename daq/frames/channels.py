"""The channel table: order of the channels, and how what a device sent becomes SI."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daq.arrays import FloatArray
from daq.errors import MachineFileError
from daq.frames.frame import row_dtype
from daq.machine.buses import Word
from daq.machine.machine_file import Channel, Machine


@dataclass(frozen=True)
class Field:
    """Bits of a raw integer that hold a channel's value."""

    channel: int
    mask: int
    signed: bool

    def of(self, raw: float) -> float:
        """Convert these bits, two's complement where signed; NaN is kept."""
        if not np.isfinite(raw):
            return raw
        lowest = self.mask & -self.mask
        value, top = (int(raw) & self.mask) // lowest, (self.mask // lowest + 1) // 2
        return float(value - 2 * top if self.signed and value & top else value)


@dataclass(frozen=True)
class ChannelTable:
    """Channels in the machine file's order; all arrays have shape (n,).

    A device sends ``raw``; the channel's unit is ``scale * raw + offset``; SI is an affine map of that. Both maps are
    one here: ``si = gain * raw + bias``, after ``fields`` and ``turns`` of what was sent.
    """

    names: tuple[str, ...]
    gain: FloatArray
    bias: FloatArray
    low: FloatArray  # SI; a value at or below it is out of range
    high: FloatArray  # SI; a value at or above it is out of range
    sentinels: tuple[tuple[int, float], ...]  # (channel, raw value that means "no valid measurement")
    fields: tuple[Field, ...] = ()  # of channels whose value is in some bits only
    turns: tuple[tuple[int, float, float], ...] = ()  # (channel, raw units of a turn, raw zero) of what begins anew

    def unwrapped(self, raw: FloatArray) -> None:
        """Unwrap bits that hold a value the short way round from an encoder's zero; (n,) as sent, in place."""
        for field in self.fields:
            raw[field.channel] = field.of(raw[field.channel])
        for channel, turn, zero in self.turns:
            raw[channel] = (raw[channel] - zero + 0.5 * turn) % turn - 0.5 * turn

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Layout of one frame of these channels."""
        return row_dtype(len(self.names))

    def index(self, name: str) -> int:
        """Return the position of a channel (ValueError if there is none of that name)."""
        return self.names.index(name)


def channel_table(machine: Machine) -> ChannelTable:
    """Build a machine's channel table; channels without a source have no scale of their own."""
    channels = machine.channels
    count = len(channels)
    gain, bias = np.empty(count), np.empty(count)
    low, high = np.full(count, -np.inf), np.full(count, np.inf)
    sentinels: list[tuple[int, float]] = []
    fields: list[Field] = []
    turns: list[tuple[int, float, float]] = []
    for i, channel in enumerate(channels):
        to_si = machine.conversion(channel)
        scale, offset = (channel.source.scale, channel.source.offset) if channel.source else (1.0, 0.0)
        if isinstance(channel.source, Word):
            word = channel.source
            scale = scale / 10.0**word.decimals
            if word.mask is not None:
                fields.append(Field(i, word.mask, not word.data_type.startswith("u")))
            if word.modulo is not None:
                turns.append((i, word.modulo, word.zero))
            else:
                offset -= scale * word.zero
        gain[i] = to_si.factor * scale
        bias[i] = to_si.factor * offset + to_si.offset
        if channel.range is not None:
            ends = to_si.to_si(channel.range)
            low[i], high[i] = ends.min(), ends.max()
        if channel.source is not None and not (isinstance(channel.source, Word) and channel.source.asks_decimals):
            sentinels += [(i, value) for value in channel.source.sentinels]
    names = tuple(channel.name for channel in channels)
    return ChannelTable(names, gain, bias, low, high, tuple(sentinels), tuple(fields), tuple(turns))


def channels_by_bus(machine: Machine, name: str = "machine file") -> dict[str, tuple[Channel, ...]]:
    """Return for every used bus, in the file's order, the channels that come from it.

    Raises
    ------
    MachineFileError
        If there are no buses, or a channel has no source: then this file is for fitting only.
    """
    if not machine.buses:
        raise MachineFileError("daq.buses_none_nothing_can", name=name)
    for channel in machine.channels:
        if channel.source is None:
            raise MachineFileError("daq.channels_no_source", name=name, channel=channel.name)
    grouped = {
        bus.name: tuple(c for c in machine.channels if c.source is not None and c.source.bus == bus.name)
        for bus in machine.buses
    }
    return {bus: channels for bus, channels in grouped.items() if channels}
