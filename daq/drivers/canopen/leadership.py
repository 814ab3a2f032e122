"""Who leads a CANopen bus. There is one way to become its leader, and it begins with listening::

                 opened: at the start, and whenever the bus is opened again
                     │
                     ▼
      opened    ┌───────────┐  listen_s without a sign of another master   ┌─────────┐
     ┌────────► │ LISTENING │ ────────────────────────────────────────────►│ LEADING │
     │          └───────────┘                                              └─────────┘
     │                │ a sign                                         a sign │  │ opened
     └────────────────┼────────────────────────────────────────────────────────┼──┘
                      ▼                                                        ▼
                ┌──────────────────────────────────────────────────────────────────┐
                │ GUEST: never left but by a new start, which is a person's doing    │
                └──────────────────────────────────────────────────────────────────┘

Only in LEADING a frame passes :meth:`Leadership.permit`; a bus with ``listen_only`` begins as GUEST. Signs of another
master are what only a master sends (NMT commands, SYNC, SDO requests, node guarding, LSS, the negotiation of CiA 302),
and what nodes only do when one told them to: operational heartbeats, PDOs, and, of nodes of ours, a state that we did
not ask for. What we told nodes ourselves, also before the bus was opened again, is no sign; neither is a node that
boots, or that reports an error before it changes its state.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable
from enum import Enum

import can

from daq.drivers.base import DriverContext
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus
from daq.messages import Sentence, in_a_row

NMT_ID, SYNC_ID, LSS_ID = 0x000, 0x080, 0x7E5
NEGOTIATION = range(0x071, 0x077)  # of several masters (CiA 302-2)
TPDOS, RPDOS = (0x180, 0x280, 0x380, 0x480), (0x200, 0x300, 0x400, 0x500)
BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
AFTER = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}  # an NMT command (CiA 301, 7.3.2.2.1)
RELISTEN_S = 1.0  # that a bus that we have led is listened to at most when it is opened again
ANSWERS_S = 0.5  # after our last SYNC, until which TPDOs may answer it
STRAYED = 2  # heartbeats in a row with another state than we asked for: of two nodes with one ID they alternate
TROUBLE_S = 5.0  # after an error of its own in which a node may change its state by itself (0x1029)
LOOK_S = 0.02


class State(Enum):
    """Permissions on a bus."""

    LISTENING = "listening"
    LEADING = "leading"
    GUEST = "guest"


class NotLeadingError(can.CanOperationError):  # type: ignore[misc]  # python-can gives it as Any
    """A frame that must not be sent."""


class Leadership:
    """Of one bus, through all its links; :meth:`received` is called in the receive thread, the others anywhere.

    Parameters
    ----------
    bus : of the machine file
    nodes : node-IDs that are ours to commission
    started : nodes that an earlier run of ours made operational and did not put back

    Attributes
    ----------
    signs : of another master, in words, and how often each was heard since the start
    reason : the sign that ended our leading; empty where nothing did
    answers : identifiers that need not be heard: TPDOs of nodes that we made operational, as long as we lead
    """

    def __init__(
        self, bus: CanopenBus, context: DriverContext, nodes: Collection[int] = (), started: Iterable[int] = ()
    ) -> None:
        self.state = State.GUEST if bus.listen_only else State.LISTENING
        self.signs: Counter[str] = Counter()
        self.reason = ""
        self.answers: set[int] = set()
        self._now = context.monotonic_ns
        # In lockstep with a simulation there is no time to listen in.
        self._listen_s = bus.listen_s if context.patience_s == 0 else 0.0
        self._nodes = frozenset(nodes)
        self._lock = threading.Lock()
        self._until_ns = self._now() + round(self._listen_s * NS)
        self._led = False
        self._sync_ns = -(10**18)  # our last one
        self._commanded: dict[int, tuple[int, int]] = dict.fromkeys(started, (OPERATIONAL, 0))  # state, since when
        self._confirmed: dict[int, int] = {}  # by heartbeat; heartbeats since that say otherwise
        self._trouble_ns: dict[int, int] = {}

    def opened(self) -> None:
        """Reset what is known of the bus: a link is about to be opened."""
        with self._lock:
            if self.state is not State.GUEST:
                self.state = State.LISTENING
            seconds = min(self._listen_s, RELISTEN_S) if self._led else self._listen_s
            self._until_ns = self._now() + round(seconds * NS)
            self._confirmed.clear()
            self.answers.clear()

    def lead(self, pause: Callable[[float], bool | None] = time.sleep, most_s: float = math.inf) -> bool:
        """Listen until the time is over, then lead; whether we do.

        Parameters
        ----------
        pause : sleeps for so many seconds; True where there is no point in listening on
        most_s : s after which this returns, although the time may not be over; another call listens on
        """
        ends_ns = min(self._until_ns, self._now() + most_s * NS)
        while self.state is State.LISTENING and (left := ends_ns - self._now()) > 0:
            if pause(min(left / NS, LOOK_S)):
                return False
        with self._lock:
            if self.state is State.LISTENING and self._now() >= self._until_ns:
                self.state, self._led = State.LEADING, True
        return self.state is State.LEADING

    def permit(self, message: can.Message) -> None:
        """Permit a frame to be sent; NotLeadingError if it must not be."""
        if self.state is not State.LEADING:
            raise NotLeadingError("nothing may be sent: " + (self.masters_seen() or "the bus is still listened to"))
        if message.arbitration_id == SYNC_ID:
            self._sync_ns = self._now()
        elif message.arbitration_id == NMT_ID:
            command, node = message.data[:2]
            self.answers.difference_update(function + node for function in TPDOS)
            self._confirmed.pop(node, None)
            self._commanded[node] = (AFTER[command], self._now())

    def masters_seen(self) -> str:
        """Word signs of another master; empty if there were none."""
        signs = self.signs.most_common(4)
        return in_a_row([Sentence("daq.count_of", count=count, what=sign) for sign, count in signs]) if signs else ""

    def count(self, what: str) -> int:
        """Count signs of one kind so far."""
        return sum(count for sign, count in list(self.signs.items()) if sign.startswith(what))

    def excused(self, node: int) -> bool:
        """Return whether a node of ours may have changed state by itself, or never was in the state asked for."""
        return node not in self._commanded or node not in self._confirmed

    def received(self, identifier: int, data: bytes | bytearray, at_ns: int, *, remote: bool = False) -> bool:
        """Take an 11-bit frame; return whether it made us a guest."""
        sign = self._sign(identifier, data, at_ns, remote)
        if sign is None:
            return False
        self.signs[f"{sign} (0x{identifier:03X})"] += 1
        with self._lock:
            if self.state is State.GUEST:
                return False
            self.state, self.reason = State.GUEST, f"{sign} (0x{identifier:03X})"
            self.answers.clear()
        return True

    def _sign(self, identifier: int, data: bytes | bytearray, at_ns: int, remote: bool) -> str | None:
        function, node = identifier & 0x780, identifier & 0x7F
        if remote:
            guarding = function == 0x700 and node
            return "node guarding" if guarding else None if self.state is State.LEADING else "remote frames"
        if identifier == NMT_ID:
            return "NMT commands"
        if identifier == SYNC_ID:
            return "SYNC"
        if identifier == LSS_ID or identifier in NEGOTIATION:
            return "LSS commands" if identifier == LSS_ID else "negotiation of masters"
        if not node:
            return None
        if function == 0x600:
            return "SDO requests"
        if function == 0x700:
            return self._heartbeat(node, data, at_ns)
        if function == 0x080 and any(data[:2]):
            self._trouble_ns[node] = at_ns
        strange = function in RPDOS or (function in TPDOS and not self._answers(identifier, node, at_ns))
        if not strange or self._listen_s == 0:
            return None
        return "RPDOs" if function in RPDOS else "TPDOs that we did not ask for"

    def _answers(self, identifier: int, node: int, at_ns: int) -> bool:
        """Return whether a TPDO may be a node's answer to us."""
        if self.state is State.LEADING:
            if node in self._commanded and self._commanded[node][0] == OPERATIONAL and at_ns > self._commanded[node][1]:
                self._confirmed.setdefault(node, 0)
                self.answers.add(identifier)
            return node in self._nodes  # the driver counts them
        return node in self._commanded and at_ns - self._sync_ns < ANSWERS_S * NS

    def _heartbeat(self, node: int, data: bytes | bytearray, at_ns: int) -> str | None:
        state = data[0] & 0x7F if data else -1
        if state == BOOT_UP:
            self._commanded.pop(node, None)
        if state not in (STOPPED, OPERATIONAL, PRE_OPERATIONAL):
            return None
        asked, since_ns = self._commanded.get(node, (-1, 0))
        if asked < 0:
            ours = node in self._nodes and self.state is State.LEADING
            strange = state == OPERATIONAL and self._listen_s > 0 and not ours
            return "heartbeats of operational nodes" if strange else None
        if state == asked:
            self._confirmed[node] = 0
        elif node in self._confirmed and at_ns > since_ns:
            if at_ns - self._trouble_ns.get(node, -(10**18)) < TROUBLE_S * NS:
                self._commanded.pop(node, None)
                return None
            self._confirmed[node] += 1
            if self._confirmed[node] >= STRAYED:
                return "a state that we did not ask for"
        return None
