"""A CANopen bus: frames by their COB-ID, SYNC, NMT, and SDO transfers to nodes.

SDO transfers wait for answers that the receive thread brings, so they run in other threads. CANopen has 11-bit
identifiers: a frame with 29 bits whose low bits are those of a TPDO is another protocol's, and a remote frame carries
no data; both are counted and go no further (:mod:`daq.drivers.can.port`).
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Any

import can
import canopen
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError

from daq.drivers.base import DriverContext
from daq.drivers.can.health import BusHealth
from daq.drivers.can.port import CanPort, first_line
from daq.errors import BusError, CommissioningError
from daq.machine.machine_file import CanopenBus

SYNC_ID = 0x080
NMT_ID = 0x000
SDO_REQUESTS = (0x601, 0x67F)
Handler = Callable[[bytearray, int], None]
SDO_TIMEOUT_S = 0.5
SDO_ATTEMPTS = 3
LOOK_S = 0.02  # between two looks whether another master was heard
SDO_SEGMENTS = 64  # answers to one transfer: no object that is read or written here has as many as 448 bytes


class CanLink(CanPort):
    """An open CANopen bus.

    ``handlers`` maps a COB-ID to what is called, in the receive thread, with data and arrival time.
    """

    def __init__(self, config: CanopenBus, context: DriverContext, health: BusHealth) -> None:
        super().__init__(config, context, health)
        self.handlers: dict[int, Handler] = {SYNC_ID: self._foreign_sync, NMT_ID: self._foreign_nmt}
        self.foreign_syncs = self.foreign_nmts = self.foreign_requests = 0  # our own do not come back to us
        self._network = canopen.Network(self)
        self._sync = can.Message(arbitration_id=SYNC_ID, is_extended_id=False, data=b"")
        self.open()

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        """Call the handler of its COB-ID."""
        handler = self.handlers.get(message.arbitration_id)
        if handler is not None:
            handler(message.data, at_ns)
        elif SDO_REQUESTS[0] <= message.arbitration_id <= SDO_REQUESTS[1]:
            self.foreign_requests += 1

    def _foreign_sync(self, data: bytearray, at_ns: int) -> None:
        self.foreign_syncs += 1

    def _foreign_nmt(self, data: bytearray, at_ns: int) -> None:
        self.foreign_nmts += 1

    def masters(self) -> str:
        """What was heard that only a master sends, in words; empty if nothing."""
        heard = (
            (self.foreign_syncs, "SYNC"),
            (self.foreign_nmts, "NMT commands"),
            (self.foreign_requests, "SDO requests"),
            (self.remote, "remote frames (node guarding)"),
        )
        return ", ".join(f"{count} {what}" for count, what in heard if count)

    def listen(self, seconds: float, pause: Callable[[float], bool | None] = time.sleep) -> str:
        """Listen before anything is sent: what only a master sends, as soon as some came, in words; empty if none did.

        Parameters
        ----------
        seconds : at most
        pause : sleeps for so many seconds; True where there is no point in listening on
        """
        deadline = time.monotonic() + seconds
        while not (heard := self.masters()) and (left := deadline - time.monotonic()) > 0:
            if pause(min(left, LOOK_S)):
                break
        return heard

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
        except (can.CanError, OSError) as error:
            self.fail(error)

    def sdo(self, node: int) -> Sdo:
        """SDO access to a node."""
        return Sdo(self, self._network, node, f"{self.name} node {node}")


class _Client(SdoClient):  # type: ignore[misc]  # canopen comes without types
    """canopen's client, which knows how many answers it had, and does not follow a transfer that never ends."""

    requests = 0
    answers = 0
    left = SDO_SEGMENTS

    def send_request(self, request: Any) -> None:
        self.requests += 1
        super().send_request(request)

    def read_response(self) -> Any:
        self.left -= 1
        if self.left < 0:
            raise SdoCommunicationError("a transfer that does not end")
        return super().read_response()

    def receive(self, data: bytearray, at_ns: int) -> None:
        """In the receive thread."""
        self.answers += 1
        self.on_response(self.tx_cobid, data, at_ns)


class Sdo:
    """SDO transfers to one node; not to be called from the receive thread."""

    def __init__(self, link: CanLink, network: Any, node: int, place: str) -> None:
        self._client = _Client(0x600 + node, 0x580 + node, canopen.ObjectDictionary())
        self._client.network = network
        self._client.RESPONSE_TIMEOUT = SDO_TIMEOUT_S
        self._link = link
        self._place = place
        link.handlers[0x580 + node] = self._client.receive

    def close(self) -> None:
        """Stop listening for the node's answers."""
        self._link.handlers.pop(self._client.tx_cobid, None)

    @property
    def surplus(self) -> int:
        """Answers beyond one per request: a second device answers as well."""
        return max(0, self._client.answers - self._client.requests)

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Bytes of an object.

        Raises
        ------
        CommissioningError
            If the node does not answer, or refuses.
        """
        what = f"0x{index:04X}:{subindex:02X}"
        return bytes(self._transfer(lambda: self._client.upload(index, subindex), f"read {what}"))

    def read_unsigned(self, index: int, subindex: int = 0) -> int:
        """An unsigned object, little endian."""
        return int.from_bytes(self.read(index, subindex), "little")

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object (errors as :meth:`read`)."""
        what = f"0x{index:04X}:{subindex:02X}"
        self._transfer(lambda: self._client.download(index, subindex, data), f"write {what}")

    def _transfer(self, transfer: Callable[[], Any], what: str) -> Any:
        reason = "does not answer"
        for attempt in range(SDO_ATTEMPTS):
            self._client.left = SDO_SEGMENTS
            try:
                return transfer()
            except SdoAbortedError as error:
                raise SdoRefusedError(
                    f"{self._place}: refuses to {what} ({error}); check the object in its manual"
                ) from None
            except SdoCommunicationError as error:
                reason = "does not answer" if "No SDO response" in str(error) else "answers with something else"
            except (can.CanError, OSError) as error:
                raise BusError(f"{self._place}: cannot {what}: {first_line(error)}; check the bus") from None
            except (struct.error, IndexError, ValueError, TypeError, AttributeError):
                # What canopen makes of a frame that is too short, or whose fields contradict each other.
                reason = "answers with frames that are no SDO"
            # A late answer would be taken for that of the next request: the next attempt starts from silence.
            if attempt + 1 < SDO_ATTEMPTS:
                time.sleep(0.05)
        raise NoAnswerError(f"{self._place}: {reason} ({what}); check its power, node-ID, bitrate and cable")


class SdoRefusedError(CommissioningError):
    """The node answered an SDO request with an abort."""


class NoAnswerError(CommissioningError):
    """The node did not answer an SDO request."""
