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
        """Whether the device has told them."""
        return not math.isnan(self._factor)

    def learn(self, places: int) -> bool:
        """The device says so many; False if that cannot be."""
        self._factor = 10.0**-places if 0 <= places <= MOST else math.nan
        return self.known

    def forget(self) -> None:
        """It may be set to others when it is back."""
        self._factor = math.nan

    def value(self, raw: float) -> float:
        """Raw value with its decimals; NaN for a sentinel, and as long as they are not known."""
        return math.nan if raw in self._sentinels else raw * self._factor
