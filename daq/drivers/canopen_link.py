"""The CAN side below CANopen: a python-can bus, its receive thread, SDO to nodes.

The receive thread copies bytes and a time stamp, nothing else: SDO transfers wait for answers that this very thread
brings, so they run in other threads. It replaces python-can's Notifier (and canopen's per-signal decoding) because at
3000 TPDOs per second each microsecond per frame is 0.3 % of a core, and because a bus error has to be seen at once.
"""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import can
import canopen
from canopen.sdo import SdoAbortedError, SdoClient, SdoCommunicationError

from daq.errors import BusError, CommissioningError
from daq.machine_file import CanopenBus

SYNC_ID = 0x080
NMT_ID = 0x000
Handler = Callable[[bytearray, int], None]
# A hub that is busy may put a frame behind its handshake's last word, which python-can takes for a wrong answer.
OPEN_ATTEMPTS = 5
OPEN_TIMEOUT_S = 2.0
SDO_TIMEOUT_S = 0.5
SDO_ATTEMPTS = 3


class CanLink:
    """An open CAN bus.

    ``handlers`` maps a COB-ID to what is called, in the receive thread, with data and arrival time.
    """

    def __init__(self, config: CanopenBus, monotonic_ns: Callable[[], int]) -> None:
        self.name = config.name
        self.handlers: dict[int, Handler] = {}
        self.error_frames = 0
        self.frames = 0
        self.failure: str | None = None
        self._monotonic_ns = monotonic_ns
        self._closing = False
        self._bus = _open(config)
        self._network = canopen.Network(self._bus)
        self._sync = can.Message(arbitration_id=SYNC_ID, is_extended_id=False, data=b"")
        self._thread = threading.Thread(target=self._receive, name=f"can-{config.name}", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        receive, handlers, now = self._bus.recv, self.handlers, self._monotonic_ns
        while not self._closing:
            try:
                message = receive(0.1)
                if message is None:
                    continue
                self.frames += 1
                if message.is_error_frame:
                    self.error_frames += 1
                    continue
                handler = handlers.get(message.arbitration_id)
                if handler is not None:
                    handler(message.data, now())
                else:
                    self._network.notify(message.arbitration_id, message.data, message.timestamp)
            except Exception as error:  # whatever it is, nothing is received from here on: the driver rebuilds the bus
                if not self._closing:
                    self.fail(error)
                return

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
        return Sdo(self._network, node, f"{self.name} node {node}")

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


class Sdo:
    """SDO transfers to one node; not to be called from the receive thread."""

    def __init__(self, network: Any, node: int, place: str) -> None:
        self._client = SdoClient(0x600 + node, 0x580 + node, canopen.ObjectDictionary())
        self._client.network = network
        self._client.RESPONSE_TIMEOUT = SDO_TIMEOUT_S
        self._network = network
        self._place = place
        network.subscribe(0x580 + node, self._client.on_response)

    def close(self) -> None:
        """Stop listening for the node's answers."""
        with contextlib.suppress(KeyError, ValueError):
            self._network.unsubscribe(self._client.tx_cobid, self._client.on_response)

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
        for attempt in range(SDO_ATTEMPTS):
            try:
                return transfer()
            except SdoAbortedError as error:
                raise SdoRefusedError(
                    f"{self._place}: refuses to {what} ({error}); check the object in its manual"
                ) from None
            except SdoCommunicationError:
                # A late answer would be taken for that of the next request: the next attempt starts from silence.
                if attempt + 1 < SDO_ATTEMPTS:
                    time.sleep(0.05)
            except (can.CanError, OSError) as error:
                raise BusError(f"{self._place}: cannot {what}: {_first_line(error)}; check the bus") from None
        raise NoAnswerError(f"{self._place}: does not answer ({what}); check its power, node-ID, bitrate and cable")


class SdoRefusedError(CommissioningError):
    """The node answered an SDO request with an abort."""


class NoAnswerError(CommissioningError):
    """The node did not answer an SDO request."""


def _first_line(error: Exception | None) -> str:
    lines = str(error).split("\n")
    return lines[0].strip() or type(error).__name__
