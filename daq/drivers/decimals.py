"""Decimals that a device tells itself (CiA 404: 0x6132; a register of many Modbus transmitters)."""

from __future__ import annotations

import math
from collections.abc import Sequence

MOST = 9


class Decimals:
    """Decimals of one channel, once the device has told them.

    Parameters
    ----------
    sentinels : raw values, before decimals, that mean "no valid measurement"
    """

    def __init__(self, sentinels: Sequence[float]) -> None:
        self._sentinels = frozenset(sentinels)
        self._factor = math.nan

    @property
    def known(self) -> bool:
        """Whether the device has sent them."""
        return not math.isnan(self._factor)

    def learn(self, places: int) -> bool:
        """Take the device's decimals; return False if they cannot be."""
        self._factor = 10.0**-places if 0 <= places <= MOST else math.nan
        return self.known

    def forget(self) -> None:
        """Forget them: they may be others when the device is back."""
        self._factor = math.nan

    def value(self, raw: float) -> float:
        """Scale a raw value by its decimals; NaN for a sentinel, or while they are unknown."""
        return math.nan if raw in self._sentinels else raw * self._factor
