"""The CAN side below CANopen: a python-can bus, its receive thread, SDO to nodes.

The receive thread copies bytes and a time stamp, nothing else: SDO transfers wait for answers that this very thread
brings, so they run in other threads. It replaces python-can's Notifier (and canopen's per-signal decoding) because at
3000 TPDOs per second each microsecond per frame is 0.3 % of a core, and because a bus error has to be seen at once.

CANopen has 11-bit identifiers. A frame with 29 bits whose low bits are those of a TPDO is another protocol's, and a
remote frame carries no data: both are counted and go no further.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable
from typing import Any

import can
import canopen
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError

from daq.drivers.arrival import ArrivalTimes
from daq.drivers.can_health import BusHealth
from daq.errors import BusError, CommissioningError
from daq.machine_file import CanopenBus

SYNC_ID = 0x080
NMT_ID = 0x000
SDO_REQUESTS = (0x601, 0x67F)
Handler = Callable[[bytearray, int], None]
# A hub that is busy may put a frame behind its handshake's last word, which python-can takes for a wrong answer.
OPEN_ATTEMPTS = 5
OPEN_TIMEOUT_S = 2.0
SDO_TIMEOUT_S = 0.5
SDO_ATTEMPTS = 3
SDO_SEGMENTS = 64  # answers to one transfer: no object that is read or written here has as many as 448 bytes
LOOK_EVERY = 64  # frames between two looks at the controller's state


class CanLink:
    """An open CAN bus.

    ``handlers`` maps a COB-ID to what is called, in the receive thread, with data and arrival time.
    """

    def __init__(self, config: CanopenBus, monotonic_ns: Callable[[], int], health: BusHealth) -> None:
        self.name = config.name
        self.handlers: dict[int, Handler] = {SYNC_ID: self._foreign_sync, NMT_ID: self._foreign_nmt}
        self.health = health
        self.frames = 0
        self.extended = self.remote = self.broken = 0  # 29-bit frames, remote frames, frames a handler stumbled over
        self.foreign_syncs = self.foreign_nmts = self.foreign_requests = 0  # our own do not come back to us
        self.failure: str | None = None
        self._monotonic_ns = monotonic_ns
        self._times = ArrivalTimes()
        self._closing = False
        self._bus = _open(config)
        self._network = canopen.Network(self._bus)
        self._sync = can.Message(arbitration_id=SYNC_ID, is_extended_id=False, data=b"")
        self._thread = threading.Thread(target=self._receive, name=f"can-{config.name}", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        receive = self._bus.recv
        while not self._closing:
            try:
                message = receive(0.1)
            except Exception as error:  # whatever it is, nothing is received from here on: the driver rebuilds the bus
                if not self._closing:
                    self.fail(error)
                return
            if message is None:
                self.health.look(self._monotonic_ns())
                continue
            self._take(message)
            if self.health.state == "bus_off":
                self.fail(can.CanOperationError("the controller is bus-off"))
                return

    def _take(self, message: Any) -> None:
        self.frames += 1
        now = self._monotonic_ns()
        if self.frames % LOOK_EVERY == 0:
            self.health.look(now)
        if message.is_error_frame:
            self.health.on_error_frame(message.arbitration_id, bytes(message.data), now)
        elif message.is_extended_id:
            self.extended += 1
        elif message.is_remote_frame:
            self.remote += 1
        elif (handler := self.handlers.get(message.arbitration_id)) is not None:
            try:
                handler(message.data, self._times.of(message.timestamp, now))
            except Exception:  # one frame that a handler cannot take is not the end of the others
                self.broken += 1
        elif SDO_REQUESTS[0] <= message.arbitration_id <= SDO_REQUESTS[1]:
            self.foreign_requests += 1

    def _foreign_sync(self, data: bytearray, at_ns: int) -> None:
        self.foreign_syncs += 1

    def masters(self) -> str:
        """What was heard that only a master sends, in words; empty if nothing."""
        heard = (
            (self.foreign_syncs, "SYNC"),
            (self.foreign_nmts, "NMT commands"),
            (self.foreign_requests, "SDO requests"),
            (self.remote, "remote frames (node guarding)"),
        )
        return ", ".join(f"{count} {what}" for count, what in heard if count)

    def _foreign_nmt(self, data: bytearray, at_ns: int) -> None:
        self.foreign_nmts += 1

    def fail(self, error: Exception) -> None:
        """Remember why the bus is unusable; the first reason counts."""
        if self.failure is None:
            self.failure = f"{type(error).__name__}: {_first_line(error)}"

    def send_sync(self) -> None:
        """Send SYNC; a failure marks the link as failed."""
        self._send(self._sync)

    def send_nmt(self, command: int, node: int) -> None:
        """Send an NMT command to one node (never to all: others on the bus are not ours)."""
        self._send(can.Message(arbitration_id=NMT_ID, is_extended_id=False, data=bytes((command, node))))

    def _send(self, message: Any) -> None:
        if self.failure is not None:
            return
        try:
            with self._network.send_lock:
                self._bus.send(message)
        except (can.CanError, OSError) as error:
            self.fail(error)

    def sdo(self, node: int) -> Sdo:
        """SDO access to a node."""
        return Sdo(self, self._network, node, f"{self.name} node {node}")

    def close(self) -> None:
        """Stop receiving and close the bus."""
        self._closing = True
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()


def _open(config: CanopenBus) -> Any:
    options: dict[str, Any] = dict(config.options)
    if config.bitrate is not None:
        options.setdefault("bitrate", config.bitrate)
    if config.interface == "socketcand":
        options.setdefault("tcp_tune", True)  # SYNC must not wait for Nagle's algorithm
        _reachable(config, str(options.get("host", "")), int(options.get("port", 0)))
        # It logs a warning for every frame that arrives in two parts, which TCP does all the time.
        logging.getLogger("can.interfaces.socketcand").setLevel(logging.CRITICAL)
    if config.listen_only:
        options.update({key: value for key, value in _silent(config.interface).items() if key not in options})
    problem: Exception | None = None
    for attempt in range(OPEN_ATTEMPTS):
        try:
            return can.Bus(interface=config.interface, channel=config.channel, **options)
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
            problem = error
            if config.interface != "socketcand" or not isinstance(error, can.CanError):
                break
            time.sleep(0.05 * (attempt + 1))
    raise BusError(
        f"bus '{config.name}': {config.interface} {config.channel} cannot be opened ({_first_line(problem)}); check "
        "interface, channel and options in the machine file, and that the interface is up"
    )


def _silent(interface: str) -> dict[str, Any]:
    """Options that keep an interface from even acknowledging frames; socketcan's is set by ``ip link``, not by us."""
    return {"pcan": {"state": can.BusState.PASSIVE}, "kvaser": {"driver_mode": False}}.get(interface, {})


def _reachable(config: CanopenBus, host: str, port: int) -> None:
    # python-can retries a refused connection for ten seconds without a pause; look first.
    try:
        socket.create_connection((host, port), timeout=OPEN_TIMEOUT_S).close()
    except OSError as error:
        raise BusError(
            f"bus '{config.name}': nothing answers at {host}:{port} ({_first_line(error)}); start the "
            "socketcand server or "
            "correct host and port"
        ) from None


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
                raise BusError(f"{self._place}: cannot {what}: {_first_line(error)}; check the bus") from None
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


def _first_line(error: Exception | None) -> str:
    lines = str(error).split("\n")
    return lines[0].strip() or type(error).__name__
