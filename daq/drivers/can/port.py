"""An open CAN interface: its receive thread, the state of its controller, and what it does when it fails.

The receive thread copies bytes and a time stamp, nothing else. It replaces python-can's Notifier because at 3000 frames
per second each microsecond per frame is 0.3 % of a core, and because a bus error has to be seen at once.
"""

from __future__ import annotations

import contextlib
import copy
import math
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar

import can

from daq.drivers.base import DriverContext
from daq.drivers.bus_driver import Port
from daq.drivers.can.health import BusHealth
from daq.drivers.can.socketcand import SocketcandBus
from daq.errors import BusError, first_line
from daq.frames.clock import NS
from daq.machine.bus_places import check_can
from daq.machine.machine_file import CanBus

TRANSIT_NS = 20_000_000  # that a gateway may take to hand on a frame: by so much one of the lines is to be contradicted
TIGHT_NS, NEAR_NS = 500_000, 300_000  # that a frame may have waited to prove an offset, and to confirm it
WINDOW_NS, STALE_NS = NS // 5, 2 * NS // 5  # in which a clock that is off by 1000 ppm is off by as little
IDLE_S = 0.1
LOOK_NS = 5_000_000  # between two looks whether a frame waits (:class:`ArrivalTimes`)
UNCERTAIN_S = 0.2e-3  # the same while times are not sure yet
LOOK_EVERY = 64  # frames between two looks at the controller's state


class ArrivalTimes:
    """When frames of one interface were on the bus, on our clock: from its time stamps, whatever its clock is.

    A thread that was kept from running takes frames late, all at once. Their time stamps, made by the kernel or a
    gateway, know better, but belong to a clock that is slewed, is set, and is a little fast or slow: the kernel's of
    SocketCAN are ``CLOCK_REALTIME``, and no interface of python-can offers ``CLOCK_MONOTONIC``. With ``taken`` on our
    clock and ``offset`` between the two::

        taken - stamp = offset + how long the frame waited       so  offset <= taken - stamp
        a frame came after any moment at which none was there    so  offset >= moment - stamp

    A clock that is set contradicts one of the two lines with its first frame. Where they are close to each other
    (:data:`TIGHT_NS`) a frame proves the offset, and one that is close to what is known confirms it; the estimate is
    the smallest of those of :data:`WINDOW_NS`, since a gateway may hand on a frame late. What is neither waited,
    however long. Without a proof or a confirmation for :data:`STALE_NS`, times are not sure, and whoever receives looks
    more often, until there is one. Frames of one interface never overtake each other.

    Attributes
    ----------
    watched : whether somebody says when no frame waited; else each is taken for one that came just now
    sure_ns : frames that came before it have times that may be wrong by more than a millisecond; infinite: all have
    uncertain : whether a proof is wanted
    restarts : clocks that were set
    """

    def __init__(self) -> None:
        self._offset = math.inf
        self._came = self._empty = self._known = 0
        self._least: deque[tuple[float, int]] = deque()  # offsets and moments of the window, each above the one before
        self.watched = self.uncertain = False
        self.sure_ns = 0.0
        self.restarts = 0

    @property
    def received_ns(self) -> int:
        """Moment up to which every frame was taken: the last that came, or at which none waited."""
        return max(self._came, self._empty)

    def nothing_at(self, now_ns: int) -> None:
        """Note that no frame waited at monotonic ``now_ns``."""
        self._empty = now_ns

    def of(self, stamp_s: float, taken_ns: int) -> int:
        """Return the monotonic ns of a frame's arrival; ``taken_ns`` where the interface gives no stamp (0)."""
        if not stamp_s > 0:
            return taken_ns
        stamp = stamp_s * NS
        offset = taken_ns - stamp
        if self._offset < math.inf and not self._empty - TRANSIT_NS <= stamp + self._offset <= taken_ns + TRANSIT_NS:
            self.restarts += 1
            self._offset, self._known = math.inf, 0
            self._least.clear()
        proven = not self.watched or taken_ns - self._empty <= TIGHT_NS
        if proven or (self._known and offset <= self._offset + NEAR_NS):
            self._known = taken_ns
            while self._least and self._least[-1][0] >= offset:
                self._least.pop()
            self._least.append((offset, taken_ns))
            while self._least[0][1] < taken_ns - WINDOW_NS:
                self._least.popleft()
            self._offset = self._least[0][0]
        else:
            self._offset = min(self._offset, offset)
        self._came = min(taken_ns, max(self._came, round(stamp + self._offset)))
        if self.watched:
            unknown_ns = taken_ns - self._known if self._known else math.inf
            self.uncertain = unknown_ns > STALE_NS / 2
            if unknown_ns > STALE_NS:
                self.sure_ns = math.inf
            elif self.sure_ns == math.inf:
                self.sure_ns = self._came
        return self._came


class CanAccess:
    """Opens a port's bus by the interface. A trace and a replay have ways of their own."""

    def attach(self, port: CanPort, config: CanBus) -> Any:
        """Make a python-can bus for a port that is being opened; may raise BusError."""
        return open_bus(config)

    def begin(self, port: CanPort) -> None:
        """Begin to receive, in a thread of its own: the port is ready."""
        port.start_receiving()

    def noted(self, name: str) -> Callable[[can.Message], None] | None:
        """Return a callback for every frame of a bus, its time stamp UTC; None if unwanted."""
        return None


class CanPort(Port):
    """An open CAN interface; :meth:`dispatch` of a subclass is called, in the receive thread, with every data frame."""

    takes_extended: ClassVar[bool] = False  # else frames with 29 bits are another protocol's: counted, no more

    def __init__(self, config: CanBus, context: DriverContext, health: BusHealth) -> None:
        self.name = config.name
        self.health = health
        self.frames = 0
        self.extended = self.remote = self.broken = 0  # 29-bit frames, remote frames, frames a handler stumbled over
        self._monotonic_ns = context.monotonic_ns
        self._times = ArrivalTimes()
        self._closing = False
        self._sending = threading.Lock()
        self._thread: threading.Thread | None = None
        access = context.can or CanAccess()
        self._noted = access.noted(config.name)
        self._utc_ns = time.time_ns() - context.monotonic_ns()  # of the clock's zero: all buses of a trace share it
        self._bus = access.attach(self, config)
        self._lost = 0
        lengthen(self._bus)
        self._begin = access.begin

    def open(self) -> None:
        """Receive from now on; the last word of a subclass's ``__init__``."""
        self._begin(self)

    def start_receiving(self) -> None:
        """Start the receive thread."""
        self._times.watched = True
        self._thread = threading.Thread(target=self._receive, name=f"can-{self.name}", daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        receive, now = self._bus.recv, self._monotonic_ns
        looked = before = 0
        while not self._closing:
            message = None
            try:
                if before - looked > LOOK_NS and (message := receive(0.0)) is None:
                    self._times.nothing_at(before)  # known well enough until the next look
                    looked = before
                if message is None and (message := receive(UNCERTAIN_S if self._times.uncertain else IDLE_S)) is None:
                    self._times.nothing_at(before)
            except Exception as error:  # whatever it is, nothing is received from here on: the driver rebuilds the bus
                if not self._closing:
                    self.fail(error)
                return
            if message is None:
                before = now()
                self.health.look(before)
                continue
            before = self.take(message)
            if message.is_error_frame and self.health.state == "bus_off":
                self.fail(can.CanOperationError("the controller is bus-off"))
                return

    def take(self, message: can.Message) -> int:
        """Take a frame, and return when it was taken, monotonic ns. It is counted once it is passed on."""
        now = self._monotonic_ns()
        if self.frames % LOOK_EVERY == 0:
            self.health.look(now)
        at_ns = self._times.of(message.timestamp, now)
        if self._noted is not None:
            message.timestamp = (at_ns + self._utc_ns) / NS
            self._noted(message)
        if message.is_error_frame:
            self.health.on_error_frame(message.arbitration_id, bytes(message.data), now)
        elif message.is_extended_id and not self.takes_extended:
            self.extended += 1
        elif message.is_remote_frame:
            self.remote += 1
            self.remote_frame(message.arbitration_id, at_ns)
        else:
            try:
                self.dispatch(message, at_ns)
            except Exception:  # one frame that a handler cannot take is not the end of the others
                self.broken += 1
        self.frames += 1
        return now

    @property
    def sure_ns(self) -> float:  # type: ignore[override]
        """Arrival by the estimate."""
        return self._times.sure_ns

    def received_ns(self, now_ns: int) -> int:
        """Return the receive thread's moment; what has none takes everything at once."""
        return min(now_ns, self._times.received_ns) if self._times.watched else now_ns

    @property
    def lost(self) -> int:
        """Frames that the kernel had no room for; 0 where unknown."""
        with contextlib.suppress(OSError):  # closed: what it counted last
            self._lost = _lost_frames(self._bus)
        return self._lost

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        """Dispatch a data frame that came at monotonic ``at_ns``."""
        raise NotImplementedError

    def remote_frame(self, identifier: int, at_ns: int) -> None:
        """Handle a remote frame that came at monotonic ``at_ns``."""

    def permit(self, message: can.Message) -> None:
        """Raise an error of python-can's if a frame must not be sent: none may, unless a subclass knows better."""
        raise can.CanOperationError("nothing is sent on a bus that is listened to")

    def send(self, message: can.Message) -> None:
        """Send a frame; errors of the interface are the caller's. ``canopen`` sends through this as well."""
        with self._sending:
            self.permit(message)
            self._bus.send(message)
        if self._noted is not None:
            sent = copy.copy(message)
            sent.is_rx, sent.timestamp = False, (self._monotonic_ns() + self._utc_ns) / NS
            self._noted(sent)

    def counts(self) -> dict[str, int]:
        """Count frames since it was opened."""
        return {
            "frames": self.frames,
            "extended_frames": self.extended,
            "remote_frames": self.remote,
            "unreadable_frames": self.broken,
            "lost_frames": self.lost,
        }

    def close(self) -> None:
        """Stop receiving and release the interface."""
        self._closing = True
        if self._thread is not None and threading.current_thread() is not self._thread:
            self._thread.join(timeout=2.0)
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()


def open_bus(config: CanBus) -> Any:
    """Open a python-can bus as the machine file describes it.

    Raises
    ------
    BusError
        If it cannot be opened.
    """
    options: dict[str, Any] = dict(config.options)
    try:  # a value that was put together in a program has met no grammar yet
        check_can(config.interface, config.channel, options)
    except (ValueError, KeyError) as error:
        raise BusError("daq.on_bus", bus=config.name, advice=first_line(error)) from None
    if config.bitrate is not None:
        options.setdefault("bitrate", config.bitrate)
    if config.listen_only:
        options.update({key: value for key, value in _silent(config.interface).items() if key not in options})
    try:
        if config.interface == "socketcand":
            return SocketcandBus(config.channel, **dict[str, Any](config.options))
        return can.Bus(interface=config.interface, channel=config.channel, ignore_config=True, **options)
    except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
        if config.interface == "socketcand":
            raise BusError(
                "daq.bus_nothing_answers",
                bus=config.name,
                option=options["host"],
                option_2=options["port"],
                error=first_line(error),
            ) from None
        raise BusError(
            "daq.bus_cannot_opened",
            bus=config.name,
            interface=config.interface,
            channel=config.channel,
            error=first_line(error),
        ) from None


def _silent(interface: str) -> dict[str, Any]:
    """Return options that keep an interface from acknowledging; socketcan's is set by ``ip link``, not by us."""
    found: dict[str, dict[str, Any]] = {
        "pcan": {"state": can.BusState.PASSIVE}, "kvaser": {"driver_mode": False}, "slcan": {"listen_only": True}
    }  # fmt: skip
    return found.get(interface, {})


QUEUE_BYTES = 8 << 20  # some thousand frames, each with its bookkeeping of about a kilobyte: a second of a full bus
_RCVBUFFORCE = 33  # asm-generic/socket.h: beyond net.core.rmem_max, for who may administer the network
_MEMINFO = 55  # asm-generic/socket.h
_DROPS = 8  # linux/sock_diag.h: SK_MEMINFO_DROPS, of unsigned 32-bit numbers


def _of(bus: Any) -> socket.socket | None:
    found = getattr(bus, "socket", None)
    family = getattr(socket, "AF_CAN", None)
    return found if isinstance(found, socket.socket) and found.family == family else None


def lengthen(bus: Any) -> None:
    """Let the kernel keep more frames for a python-can bus, as many as it allows."""
    queue = _of(bus)
    if queue is None:
        return
    for option in (socket.SO_RCVBUF, _RCVBUFFORCE):
        with contextlib.suppress(OSError):
            queue.setsockopt(socket.SOL_SOCKET, option, QUEUE_BYTES)


def _lost_frames(bus: Any) -> int:
    """Count frames that the kernel had no room for since opening; 0 where unknown.

    Raises
    ------
    OSError
        If it is closed.
    """
    queue = _of(bus)
    if queue is None:
        return 0
    content = queue.getsockopt(socket.SOL_SOCKET, _MEMINFO, 4 * (_DROPS + 1))
    return int(struct.unpack_from("=I", content, 4 * _DROPS)[0]) if len(content) > 4 * _DROPS else 0
