"""What can be wrong between a simulated node and its bus: frames that are late, lost, doubled or garbled.

A filter between the node, which knows nothing of it, and the bus. Delays are counted in SYNCs, because to a simulated
machine nothing but SYNC is time.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable

Emit = Callable[[int, bytes], None]  # COB-ID, data
_TPDOS = (0x180, 0x280, 0x380, 0x480)
KINDS = ("lag", "lose", "drop", "corrupt", "doubled", "garbled")


class FaultyLine:
    """One node's frames on their way to the bus.

    Attributes
    ----------
    lag : SYNCs by which TPDOs come too late
    lose : TPDOs that are still to be lost
    drop : share of the TPDOs that are lost
    corrupt : share of the TPDOs that are disturbed on the cable: their check sum does not fit, so that everybody sees
        an error frame instead of them
    doubled : a second device with the same node-ID: TPDOs and SDO answers come twice, with other values
    garbled : SDO answers are cut to two bytes
    """

    def __init__(self, node: int, emit: Emit, emit_error: Callable[[], None] = lambda: None) -> None:
        self._node = node
        self._emit = emit
        self._emit_error = emit_error
        self._random = random.Random(node)
        self._syncs = 0
        self._delayed: deque[tuple[int, int, bytes]] = deque()
        self.lag = self.lose = 0
        self.drop = self.corrupt = 0.0
        self.doubled = self.garbled = False

    def on_sync(self) -> None:
        """Send at a SYNC what was delayed until now."""
        self._syncs += 1
        while self._delayed and (not self.lag or self._delayed[0][0] <= self._syncs):
            _, cob_id, data = self._delayed.popleft()
            self._emit(cob_id, data)

    def emit(self, cob_id: int, data: bytes) -> None:
        """Send a frame from the node."""
        function = cob_id - self._node
        if function == 0x580:
            data = data[:2] if self.garbled else data
        elif function in _TPDOS and self._spoilt(cob_id, data):
            return
        self._emit(cob_id, data)
        if self.doubled:
            self._emit(cob_id, data[:-1] + bytes([data[-1] ^ 0x01]) if data else data)

    def _spoilt(self, cob_id: int, data: bytes) -> bool:
        """Test whether a TPDO does not get through now."""
        if self.lose:
            self.lose -= 1
            return True
        if self.drop and self._random.random() < self.drop:
            return True
        if self.corrupt and self._random.random() < self.corrupt:
            self._emit_error()
            return True
        if self.lag:
            self._delayed.append((self._syncs + self.lag, cob_id, data))
            return True
        return False
