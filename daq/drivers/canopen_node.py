"""What the driver knows of one CANopen node: its TPDOs as they arrive, its heartbeat, its emergencies."""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Callable

from daq.drivers.canopen_mapping import Mapping
from daq.machine_file import CanNode

MISSES_TOLERATED = 3  # cycles without an answer after which a node is not waited for any more
MISSES_LOST = 25  # cycles without an answer, the heartbeat going on, after which it is commissioned again
WRONG_TOLERATED = 3  # TPDOs of a wrong length after which a node's mapping is taken for lost
WATCHDOG_PERIODS = 2.5  # heartbeat periods without a sign of life
BOOT_UP, STATE_STOPPED, STATE_OPERATIONAL, STATE_PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
_EMERGENCY = struct.Struct("<HB")


class Cycle:
    """The cycle that is under way, shared by the receive thread and the one that collects."""

    def __init__(self) -> None:
        self.number = 0
        self.sync_ns = 0
        self.done = threading.Event()
        self._lock = threading.Lock()
        self._pending: set[int] = set()

    def begin(self, number: int, sync_ns: int, expected: set[int]) -> None:
        """Start cycle ``number`` in which TPDOs of the COB-IDs ``expected`` are waited for."""
        with self._lock:
            self.number, self.sync_ns, self._pending = number, sync_ns, expected
            if expected:
                self.done.clear()
            else:
                self.done.set()

    def arrived(self, cob_id: int) -> int:
        """A TPDO came; the number of the cycle that it counts for."""
        with self._lock:
            self._pending.discard(cob_id)
            if not self._pending:
                self.done.set()
            return self.number


class Tpdo:
    """The last frame of one TPDO; :meth:`receive` runs in the receive thread."""

    __slots__ = ("_of", "arrived_ns", "count", "cycle", "data", "mapping", "taken", "wrong", "wrong_length")

    def __init__(self, mapping: Mapping, of: Cycle) -> None:
        self.mapping = mapping
        self.data = b""
        self.cycle = -1
        self.arrived_ns = 0
        self.count = 0
        self.taken = 0
        self.wrong = 0
        self.wrong_length = 0
        self._of = of

    def receive(self, data: bytearray, now_ns: int) -> None:
        """Keep the bytes and the time, if the length is right; canopen itself accepts a short PDO without a word."""
        if len(data) != self.mapping.length:
            self.wrong_length = len(data)
            self.wrong += 1
            return
        self.data = bytes(data)
        self.arrived_ns = now_ns
        self.count += 1
        self.cycle = self._of.arrived(self.mapping.cob_id)


class Node:
    """State of one node.

    ``state`` is ``commissioning``, ``running``, ``silent`` or ``failed``; it changes in the driver's threads, never in
    the receive thread, which only leaves time stamps, counts and bytes behind.
    """

    def __init__(self, config: CanNode, place: str, mappings: tuple[Mapping, ...], cycle: Cycle) -> None:
        self.config = config
        self.place = place
        self.mappings = mappings
        self.tpdos = tuple(Tpdo(mapping, cycle) for mapping in mappings)
        self.cob_ids = frozenset(mapping.cob_id for mapping in mappings)
        self.state = "commissioning"
        self.detail = ""
        self.misses = 0
        self.emergency: int | None = None
        self.heartbeat_ns = 0
        self.heartbeat_state = -1
        self.boot_ups = 0
        self.boot_ups_seen = 0
        self.wrong_seen = 0
        self.wrong_run = 0
        self.emergencies: deque[bytes] = deque(maxlen=64)

    def handlers(self) -> dict[int, Callable[[bytearray, int], None]]:
        """What to call for which COB-ID."""
        found: dict[int, Callable[[bytearray, int], None]] = {t.mapping.cob_id: t.receive for t in self.tpdos}
        found[0x700 + self.config.node] = self.on_heartbeat
        found[0x080 + self.config.node] = self.on_emergency
        return found

    def on_heartbeat(self, data: bytearray, now_ns: int) -> None:
        """Heartbeat or boot-up message; bit 7 is node guarding's toggle bit."""
        state = data[0] & 0x7F if data else -1
        self.heartbeat_ns = now_ns
        self.heartbeat_state = state
        if state == BOOT_UP:
            self.boot_ups += 1

    def on_emergency(self, data: bytearray, now_ns: int) -> None:
        """EMCY message: 16 bits of error code first; taken apart in the driver's thread."""
        self.emergencies.append(bytes(data))

    def take_emergencies(self) -> int:
        """Work off what came; returns the number of new errors. Code 0x00xx resets the error."""
        count = 0
        while self.emergencies:
            data = self.emergencies.popleft()
            if len(data) < _EMERGENCY.size:
                continue
            code = int(_EMERGENCY.unpack_from(data)[0])
            self.emergency = code if code & 0xFF00 else None
            count += self.emergency is not None
        return count

    def wrong_lengths(self) -> int:
        """TPDOs of a wrong length so far."""
        return sum(tpdo.wrong for tpdo in self.tpdos)

    def last_sign_ns(self) -> int:
        """When anything came from it."""
        return max(self.heartbeat_ns, *(tpdo.arrived_ns for tpdo in self.tpdos))

    def short(self) -> str | None:
        """A line about a TPDO of the wrong length, if one came since the last commissioning."""
        for tpdo in self.tpdos:
            if tpdo.wrong_length:
                return (
                    f"{self.place}: TPDO{tpdo.mapping.number} has {tpdo.wrong_length} bytes instead of "
                    f"{tpdo.mapping.length}; its mapping is not the one that was written: see its manual"
                )
        return None

    def forget(self) -> None:
        """Before a commissioning: what came so far does not count."""
        self.emergency = None
        self.emergencies.clear()
        self.misses = 0
        self.heartbeat_state = -1
        self.wrong_seen = self.wrong_lengths()
        self.wrong_run = 0
        for tpdo in self.tpdos:
            tpdo.count = tpdo.taken = 0
            tpdo.wrong_length = 0
            tpdo.cycle = -1

    def accept_boot_ups(self) -> None:
        """Boot-ups up to now are no news."""
        self.boot_ups_seen = self.boot_ups

    def complete(self) -> bool:
        """Whether every TPDO came at least once since :meth:`forget`."""
        return all(tpdo.count > 0 for tpdo in self.tpdos)
