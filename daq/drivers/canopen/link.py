"""A CANopen bus: frames by their COB-ID, SYNC, NMT, and SDO transfers to nodes.

SDO transfers wait for answers that the receive thread brings, so they run in other threads. CANopen has 11-bit
identifiers: a frame with 29 bits whose low bits are those of a TPDO is another protocol's, and a remote frame carries
no data; both are counted and go no further (:mod:`daq.drivers.can.port`).
"""

from __future__ import annotations

import struct
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import can
import canopen
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError
from canopen.sdo.constants import REQUEST_ABORTED

from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.can.port import CanPort
from daq.drivers.canopen.leadership import NMT_ID, SYNC_ID, Leadership, NotLeadingError
from daq.errors import BusError, CommissioningError, first_line
from daq.frames.clock import NS
from daq.machine.machine_file import CanopenBus
from daq.messages import Sentence

Handler = Callable[[bytearray, int], None]
SDO_TIMEOUT_S = 0.5
SDO_ATTEMPTS = 3
SDO_ANSWER_S = 3.0  # after which an answer is taken for lost: behind a gateway, or on a computer, that is too busy
SDO_SEGMENTS = 64  # answers to one transfer: no object that is read or written here has as many as 448 bytes
#: Why a transfer failed where nothing came at all.
_SILENT = "does not answer"


class CanLink(CanPort):
    """An open CANopen bus.

    ``handlers`` maps a COB-ID to what is called, in the receive thread, with data and arrival time.

    Parameters
    ----------
    leadership : hears every frame, and permits every one of ours
    """

    def __init__(
        self, config: CanopenBus, context: DriverContext, health: BusHealth, leadership: Leadership | None = None
    ) -> None:
        super().__init__(config, context, health)
        self.leadership = Leadership(config, context) if leadership is None else leadership
        self.leadership.opened()
        self._answers = self.leadership.answers
        self.handlers: dict[int, Handler] = {}
        self._network = canopen.Network(self)
        self._sync = can.Message(arbitration_id=SYNC_ID, is_extended_id=False, data=b"")
        self._clients: dict[int, _Client] = {}  # by node
        self._attempts = SDO_ATTEMPTS
        self.open()

    def permit(self, message: can.Message) -> None:
        """Ask leadership."""
        self.leadership.permit(message)

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        """Pass it to leadership, then call the handler of its COB-ID."""
        identifier = message.arbitration_id
        if identifier not in self._answers and self.leadership.received(identifier, message.data, at_ns):
            self._let_go()
        handler = self.handlers.get(identifier)
        if handler is not None:
            handler(message.data, at_ns)

    def remote_frame(self, identifier: int, at_ns: int) -> None:
        """Note a master: only one asks nodes for their state, and for their PDOs."""
        if self.leadership.received(identifier, b"", at_ns, remote=True):
            self._let_go()

    def _let_go(self) -> None:
        """End transfers that are under way: with what is no answer, their next request is not permitted."""
        for client in list(self._clients.values()):
            client.responses.put(b"")

    def hurry(self) -> None:
        """Ask a node that does not answer once only from now on: who stops need not wait for it."""
        self._attempts = 1
        for client in list(self._clients.values()):
            client.attempts = 1

    def send_sync(self) -> None:
        """Send SYNC; a failure marks the link as failed."""
        self._send(self._sync)

    def send_nmt(self, command: int, node: int) -> None:
        """Send an NMT command to one node (never to all: others on the bus are not ours)."""
        self._send(can.Message(arbitration_id=NMT_ID, is_extended_id=False, data=bytes((command, node))))

    def _send(self, message: can.Message) -> None:
        if self.failure is not None:
            return
        try:
            self.send(message)
        except NotLeadingError:  # another master was heard meanwhile: the driver sees to it
            pass
        except (can.CanError, OSError) as error:
            self.fail(error)

    def sdo(self, node: int) -> Sdo:
        """Return SDO access to a node."""
        if node not in self._clients:
            client = self._clients[node] = _Client(self._network, node, self._monotonic_ns)
            client.attempts = self._attempts
            self.handlers[0x580 + node] = client.receive
        return Sdo(self._clients[node], f"{self.name} node {node}")


class _Client(SdoClient):  # type: ignore[misc]  # canopen comes without types
    """canopen's client, which knows answers that nothing was asked for, and does not follow a transfer without end.

    Attributes
    ----------
    surplus : answers that none of our requests of the last :data:`SDO_ANSWER_S` waits for
    attempts : how often a transfer is begun, at most
    """

    RESPONSE_TIMEOUT = SDO_TIMEOUT_S
    left = SDO_SEGMENTS
    surplus = 0
    attempts = SDO_ATTEMPTS

    def __init__(self, network: Any, node: int, monotonic_ns: Callable[[], int]) -> None:
        super().__init__(0x600 + node, 0x580 + node, canopen.ObjectDictionary())
        self.network = network
        self._now = monotonic_ns
        self._asked: deque[int] = deque()

    def send_request(self, request: Any) -> None:
        if request[0] != REQUEST_ABORTED:  # it has no answer
            self._asked.append(self._now())
        super().send_request(request)

    def read_response(self) -> Any:
        self.left -= 1
        if self.left < 0:
            raise SdoCommunicationError("a transfer that does not end")
        return super().read_response()

    def receive(self, data: bytearray, at_ns: int) -> None:
        """Receive, in the receive thread."""
        while self._asked and at_ns - self._asked[0] > SDO_ANSWER_S * NS:
            self._asked.popleft()
        if self._asked:
            self._asked.popleft()
        else:
            self.surplus += 1
        self.on_response(self.tx_cobid, data, at_ns)


class Sdo:
    """SDO transfers to one node; not to be called from the receive thread."""

    def __init__(self, client: _Client, place: str) -> None:
        self._client = client
        self._place = place
        client.surplus = 0

    @property
    def surplus(self) -> int:
        """Answers that nothing was asked for: a second device answers as well."""
        return self._client.surplus

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Read bytes of an object.

        Raises
        ------
        CommissioningError
            If the node does not answer, or refuses.
        """
        what = f"0x{index:04X}:{subindex:02X}"
        return bytes(
            self._transfer(lambda: self._client.upload(index, subindex), Sentence("daq.read_object", what=what))
        )

    def read_unsigned(self, index: int, subindex: int = 0) -> int:
        """Read an unsigned object, little endian."""
        return int.from_bytes(self.read(index, subindex), "little")

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object (errors as :meth:`read`)."""
        what = f"0x{index:04X}:{subindex:02X}"
        self._transfer(lambda: self._client.download(index, subindex, data), Sentence("daq.write_object", what=what))

    def _transfer(self, transfer: Callable[[], Any], what: str) -> Any:
        reason = _SILENT
        for attempt in range(SDO_ATTEMPTS):
            self._client.left = SDO_SEGMENTS
            try:
                return transfer()
            except SdoAbortedError as error:
                raise SdoRefusedError("daq.refuses_to", place=self._place, what=what, error=error) from None
            except SdoCommunicationError as error:
                reason = _SILENT if "No SDO response" in str(error) else "answers with something else"
            except (can.CanError, OSError) as error:
                raise BusError("daq.cannot_do", place=self._place, what=what, error=first_line(error)) from None
            except (struct.error, IndexError, ValueError, TypeError, AttributeError):
                # What canopen makes of a frame that is too short, or whose fields contradict each other.
                reason = "answers with frames that are no SDO"
            # A late answer would be taken for that of the next request: the next attempt starts from silence.
            if attempt + 1 >= self._client.attempts:
                break
            time.sleep(0.05)
        kind = NoAnswerError if reason == _SILENT else WrongAnswerError
        raise kind("daq.no_answer_to", place=self._place, reason=reason, what=what)


class SdoRefusedError(CommissioningError):
    """The node answered an SDO request with an abort."""


class NoAnswerError(CommissioningError):
    """The node did not answer an SDO request."""


class WrongAnswerError(NoAnswerError):
    """A node answers, but with nothing that can be understood."""
