"""Faults of a single signal of a simulated device: the sensor itself, before anything is sent."""

from __future__ import annotations

import math
import random

KINDS = ("freeze", "nan", "noise_burst", "bias_step", "saturate")


class SignalFaults:
    """Faults of the signals of one device, by channel; sizes are in raw units.

    ``freeze`` the value stands still; ``nan`` it is no number; ``noise_burst`` white noise of that standard deviation
    is added; ``bias_step`` so much is added; ``saturate`` it stays at that value.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._faults: dict[str, dict[str, float]] = {}
        self._held: dict[str, float] = {}

    def set(self, channel: str, kind: str, size: float, on: bool) -> None:
        """Begin or end one fault of a channel; others of it go on."""
        if kind not in KINDS:
            raise ValueError(f"no fault '{kind}'")
        faults = self._faults.setdefault(channel, {})
        if on:
            faults[kind] = size
        else:
            faults.pop(kind, None)
        if kind == "freeze":
            self._held.pop(channel, None)
        if not faults:
            del self._faults[channel]

    def apply(self, channel: str, raw: float) -> float:
        """Compute what the sensor reads where ``raw`` is right."""
        faults = self._faults.get(channel)
        if faults is None:
            return raw
        if "noise_burst" in faults:
            raw += self._random.gauss(0.0, faults["noise_burst"])
        raw += faults.get("bias_step", 0.0)
        if "freeze" in faults:
            raw = self._held.setdefault(channel, raw)
        return math.nan if "nan" in faults else faults.get("saturate", raw)
