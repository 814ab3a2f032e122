"""The ledger of a recording: of every value that was due, whether it is in the file, or why not.

Per channel ``produced = stored + dropped``. A value is due in every cycle, from the first one recorded to the last,
also in those that never happened (a skipped one has a number), but not in cycles in which a device with a rate of its
own owed nothing. It is stored if the file has a number for it (its quality says what that number is worth), and else
dropped somewhere, for a reason: :data:`REASONS`, :data:`SKIPPED`, :data:`OVERWRITTEN`.

``produced`` is counted by the numbers of the cycles, ``stored`` by what was handed to the disk, ``dropped`` by flags
and holes: that they agree is a check, not a definition.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.arrays import BoolArray, FlagArray
from daq.quality import Quality
from daq.recordings.recording_files import numbers_of

if TYPE_CHECKING:
    import pyarrow as pa

SKIPPED, OVERWRITTEN = "acquisition: cycle skipped", "ring: overwritten"
REASONS = {
    Quality.STALE: "bus: nothing came",
    Quality.MISSING: "bus: nothing came",
    Quality.BUS_ERROR: "bus: down",
    Quality.INVALID: "device: invalid",
    Quality.EMERGENCY: "device: emergency",
}
FRAME, SKIP, LOST = 0, 1, 2  # what a row stands for: a frame, a cycle that never happened, a frame the ring lost
EMPTY = 3  # a journal does not say which: a row without any value
EMPTIED, DAMAGED = "recovered: a row without values", "recovered: damaged batch"


@dataclass
class ChannelLedger:
    """One channel: values that were due, that are in the file, and that are not, by place and reason."""

    produced: int = 0
    stored: int = 0
    dropped: Counter[str] = field(default_factory=Counter)

    @property
    def balanced(self) -> bool:
        """True where every value is accounted for."""
        return self.produced == self.stored + sum(self.dropped.values())

    def as_dict(self) -> dict[str, Any]:
        """Return content for JSON."""
        return {"produced": self.produced, "stored": self.stored, "dropped": dict(sorted(self.dropped.items()))}


class Ledger:
    """The ledger of all channels of a recording; :meth:`close` balances it."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.channels = {name: ChannelLedger() for name in names}
        self._names = names
        self._held = np.zeros(len(names), dtype=np.int64)

    def add(self, quality: FlagArray, stored: BoolArray, origin: FlagArray) -> None:
        """Add rows that are safe on disk: (N, n) flags, (N, n) presence in the file, (N,) row's origin."""
        absent = ~stored
        frames = origin == FRAME
        self._held += ((quality == Quality.HELD) & frames[:, None]).sum(axis=0)
        for index, name in enumerate(self._names):
            channel = self.channels[name]
            held = (quality[:, index] == Quality.HELD) & frames
            channel.stored += int((stored[:, index] & ~held).sum())
            missing = absent[:, index] & ~held
            for reason, rows in ((SKIPPED, origin == SKIP), (OVERWRITTEN, origin == LOST), (EMPTIED, origin == EMPTY)):
                channel.dropped[reason] += int((missing & rows).sum())
            flags, counts = np.unique(quality[missing & frames, index], return_counts=True)
            for flag, count in zip(flags.tolist(), counts.tolist(), strict=True):
                channel.dropped[REASONS.get(Quality(flag), f"unknown: {Quality(flag).name.lower()}")] += count

    def close(self, first_cycle: int | None, last_cycle: int | None) -> None:
        """Count what was due by the numbers of the first and the last cycle recorded (None: there was none)."""
        cycles = 0 if first_cycle is None or last_cycle is None else last_cycle - first_cycle + 1
        for index, channel in enumerate(self.channels.values()):
            channel.produced = cycles - int(self._held[index])
            channel.dropped = +channel.dropped

    @property
    def balanced(self) -> bool:
        """True where every value of every channel is accounted for."""
        return all(channel.balanced for channel in self.channels.values())

    def as_dict(self) -> dict[str, Any]:
        """Return content for JSON."""
        return {name: channel.as_dict() for name, channel in self.channels.items()}


def ledger_of(table: pa.Table) -> dict[str, Any]:
    """Reconstruct the ledger from a recording's rows: for one whose recorder was killed."""
    names = tuple(name.removesuffix(".quality") for name in table.column_names if name.endswith(".quality"))
    quality = np.column_stack([numbers_of(table.column(f"{name}.quality")) for name in names])
    stored = np.column_stack([np.isfinite(numbers_of(table.column(name))) for name in names])
    cycles = numbers_of(table.column("cycle"))
    ledger = Ledger(names)
    ledger.add(quality, stored, np.where((quality == Quality.MISSING).all(axis=1), EMPTY, FRAME).astype(np.uint8))
    for channel in ledger.channels.values():
        channel.dropped[DAMAGED] = int(cycles[-1] - cycles[0]) + 1 - len(cycles)
    ledger.close(int(cycles[0]), int(cycles[-1]))
    return ledger.as_dict()
