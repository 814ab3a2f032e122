"""Token buckets, which bound how often somebody may ask."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

#: Buckets that are kept; beyond it those not used for longest are forgotten (they are full again by then).
MOST_BUCKETS = 10_000


@dataclass(frozen=True)
class Rate:
    """``per_second`` requests in the long run, ``burst`` at once."""

    per_second: float
    burst: int


class Rates:
    """A bucket per name; each request takes one token out, time puts them back."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait(self, name: str, rate: Rate) -> int:
        """Take a token; 0, or the whole seconds after which there is one."""
        now = self._clock()
        tokens, seen = self._buckets.pop(name, (float(rate.burst), now))
        tokens = min(float(rate.burst), tokens + (now - seen) * rate.per_second)
        taken = tokens >= 1
        self._buckets[name] = (tokens - 1 if taken else tokens, now)
        if len(self._buckets) > MOST_BUCKETS:
            self._buckets.popitem(last=False)
        return 0 if taken else math.ceil((1 - tokens) / rate.per_second)
