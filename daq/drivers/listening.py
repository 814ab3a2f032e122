"""A bus that is only listened to: nothing is ever sent, frames are taken as they come.

Our clock paces the cycle. What came since the last one is fresh, with its age from its own time stamp; older than one
and a half periods (the receive thread was kept from running) it is late. A frame that comes less often than the cycle
has a rate of its own: between two of them its channels are held.
"""

from __future__ import annotations

import math
import statistics
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Sequence

from daq.drivers.base import Answers, DeviceStatus, DriverContext, Problem, Samples, nothing
from daq.drivers.bus_driver import BusDriver
from daq.frames.clock import NS
from daq.machine.machine_file import Bus
from daq.messages import Sentence
from daq.quality import Quality

INTERVALS = 9  # of which the median is taken for a frame's own
REGULAR = 0.1  # of the median, by which no interval of a frame with a period of its own is off
NEAR = 0.15  # of a period, by which a frame that is where it is due may be off; or so many of its largest deviations:
DEVIATIONS = 3
BEHIND = 4  # frames in a row that are late after a stall; then they were lost
HITS = 6  # frames in a row where they were due with others between them: two senders
ELSEWHERE = 2  # frames in a row where they were not due, behind others: one that also sends changes
PULL = 0.25  # of what a frame is off, by which the next one is expected otherwise
SUSPECT = 12  # frames after the last one too many in which a stream is still another's
HALF = 16  # frames of each half that are compared
SILENT_S = 1.0  # without a frame that comes in every cycle; or three of its intervals
FIRST_S = 2.0  # that a frame is waited for at the start
LATE_PERIODS = 1.5
INBOX = 256  # frames of one identifier that are kept until the cycle takes them


class Pace:
    """Rate of the frames of one stream, and whether two devices send it: by its period and by what it holds.

    A frame that one sender repeats comes once per period; one that is late is caught up with, so that after a stall
    several may come at once. One that comes early is one too many, unless its sender repeats it and also sends it when
    a value changes: then its timer begins anew, and the next one comes where it was not due (CiA 301, 7.5.2.37). Of two
    senders the first one's timer goes on. From then on nobody can say which frame is whose. Two senders that were there
    from the start look like one of twice the rate; but what every second frame holds belongs together: all values of
    the one half are above all of the other half, which noise does with a probability of 2 in ``C(32, 16)``, 3e-9, and a
    motion not at all.

    Parameters
    ----------
    declared_ns : interval that its description promises, if any
    """

    def __init__(self, declared_ns: float | None = None) -> None:
        self._declared_ns = declared_ns
        self._intervals: deque[int] = deque(maxlen=INTERVALS)
        self._last: int | None = None
        self._median = 0.0
        self._period = 0.0  # of one sender, once it was regular
        self._near = 0.0  # ns that a frame may be off
        self._due = 0.0
        self._early = self._late = self._hits = self._elsewhere = self._suspect = 0
        self._sends_changes = False
        self._held: deque[tuple[float, ...]] = deque(maxlen=2 * HALF)

    @property
    def interval_ns(self) -> float:
        """Time between two frames, ns; 0 while it is not known."""
        return self._declared_ns or self._median

    @property
    def known(self) -> bool:
        """True once enough frames came to decide it."""
        return len(self._held) == 2 * HALF

    def arrived(self, at_ns: int) -> bool:
        """Take a frame; return whether it may be another sender's."""
        last, self._last = self._last, at_ns
        if last is None:
            return False
        self._intervals.append(at_ns - last)
        self._suspect -= self._suspect > 0
        if self._period:
            early = self._look(at_ns)
            if self._suspect or (early and not self._sends_changes):
                self._intervals.clear()  # of one sender the period is, not of two
                return True
        self._median = statistics.median(self._intervals)
        off = max(abs(interval - self._median) for interval in self._intervals)
        if len(self._intervals) == INTERVALS and off <= REGULAR * self._median:
            if not self._period:
                self._due = at_ns + self._median
            self._period, self._near = self._median, max(NEAR * self._median, DEVIATIONS * off)
        return False

    def _look(self, at_ns: int) -> bool:
        """Return whether a frame came before it was due."""
        if at_ns < self._due - self._near:
            self._early += 1
            if self._suspect:
                self._suspect = SUSPECT
            return True
        in_time = at_ns <= self._due + self._near
        behind = self._early > 0
        if behind:
            self._hits = self._hits + 1 if in_time else 0
            self._elsewhere = 0 if in_time else self._elsewhere + 1
            if self._elsewhere >= ELSEWHERE:
                self._sends_changes, self._suspect = True, 0
            elif self._hits >= HITS and not self._sends_changes:
                self._suspect = SUSPECT
        self._early = 0
        self._late = 0 if in_time else self._late + 1
        lost = self._late >= BEHIND or self._sends_changes or (behind and not in_time)
        pull = 1.0 if lost else PULL if in_time else 0.0
        self._due += self._period + pull * (at_ns - self._due)
        return False

    def mixed(self, values: Sequence[float]) -> bool:
        """Take a frame's content; return whether alternate ones are another sender's."""
        held = self._held
        held.append(tuple(values))
        if len(held) < 2 * HALF:
            return False
        for channel in zip(*held, strict=False):
            ours, theirs = channel[::2], channel[1::2]
            if all(map(math.isfinite, channel)) and (max(ours) < min(theirs) or max(theirs) < min(ours)):
                return True
        return False


class Stream:
    """Frames that always carry the same channels: a PDO, a message, or one multiplexed part of it.

    Parameters
    ----------
    name : how lines call it
    device : name of the device that it is listed under
    positions : its channels, in the driver's order
    declared_ns : interval that its description promises, if any
    """

    def __init__(self, name: str, device: str, positions: Sequence[int], declared_ns: float | None = None) -> None:
        self.name = name
        self.device = device
        self.positions = tuple(positions)
        self.at_ns: int | None = None
        self.fault = ""  # what was wrong with its last frame
        self.pace = Pace(declared_ns)

    def arrived(self, at_ns: int) -> bool:
        """Take one of its frames, of ``at_ns``; return whether it may be another sender's."""
        self.at_ns = at_ns
        return self.pace.arrived(at_ns)

    @property
    def interval_ns(self) -> float:
        """Time between two of its frames, ns; 0 while it is not known."""
        return self.pace.interval_ns


class Inbox:
    """Frames of one identifier between receive thread and cycle; ``keep`` of them, the newest."""

    def __init__(self, keep: int) -> None:
        self._frames: deque[tuple[bytes, int, int]] = deque(maxlen=keep)
        self.arrived = threading.Event()

    def receive(self, data: bytes | bytearray, at_ns: int, sender: int = 0) -> None:
        """Receive, in the receive thread."""
        self._frames.append((bytes(data), at_ns, sender))
        self.arrived.set()

    def taken(self) -> Iterator[tuple[bytes, int, int]]:
        """Take data, time and sender of all that came, the oldest first."""
        self.arrived.clear()
        while self._frames:
            yield self._frames.popleft()


class Listener(BusDriver):
    """The common part of drivers that only listen (see :class:`daq.drivers.base.Driver`).

    A subclass fills ``streams`` and says how a port is made (:meth:`connected`) and what frames hold (:meth:`decode`).
    """

    leads = False

    def __init__(self, config: Bus, names: Sequence[str], context: DriverContext, counts: Iterable[str] = ()) -> None:
        super().__init__(config, names, context, ("missing", "late", "short", "not_a_number", "two_senders", *counts))
        self.streams: list[Stream] = []
        self.cycle_ns = self._received_ns = 0
        self.led = False  # whether the cycle began with another master's SYNC, at cycle_ns
        self._silent: set[str] = set()

    def decode(self, answers: Answers) -> None:
        """Take what came, and put it into the answers with :meth:`came` and their ``value``."""
        raise NotImplementedError

    def device_line(self, device: str) -> str:
        """Return the line about a device whose frames come."""
        return ""

    def start(self) -> tuple[str, ...]:
        """Open the bus and wait a moment for every frame."""
        self.keeper.start()
        self.open()
        deadline = self.context.monotonic_ns() + round(self.context.at_start(FIRST_S) * NS)
        while self.port is not None and (left := deadline - self.context.monotonic_ns()) > 0:
            self.decode(Answers(len(self._names)))
            known = all(stream.at_ns is not None and stream.pace.known for stream in self.streams)
            if known or self.keeper.paused(min(self.context.period_s, left / NS)):
                break
        if self.port is None:
            return (Problem(self.failure, self._names),)
        return tuple(
            Problem(
                Sentence("daq.stream_does_not_come", bus=self.config.name, stream=stream.name),
                [self._names[position] for position in stream.positions],
            )
            for stream in self.streams
            if stream.at_ns is None
        )

    def trigger(self, cycle: int) -> None:
        """Send nothing."""
        self.cycle_ns = self.context.monotonic_ns()

    def collect(self, until_ns: int) -> Samples:
        """Collect what came since the last cycle."""
        if not self.working():
            self.keeper.later()
            return nothing(len(self._names), Quality.BUS_ERROR)
        answers = Answers(len(self._names))
        if self.port is not None:
            self._received_ns = self.port.received_ns(self.cycle_ns)
        self.decode(answers)
        self.counts["not_a_number"] += answers.no_numbers
        for stream in self.streams:
            every = stream.interval_ns / NS / self.context.period_s
            if stream.at_ns is not None and every > LATE_PERIODS:
                for position in stream.positions:
                    answers.interval[position] = every
            elif all(answers.quality[position] == Quality.MISSING for position in stream.positions):
                self.counts["missing"] += 1
        self._look()
        return answers.samples(from_tick=self.led)

    def came(self, stream: Stream, at_ns: int, answers: Answers) -> Quality:
        """Take a stream's frame: return its age and the quality of its content."""
        stream.fault = ""
        if stream.arrived(at_ns):
            self.counts["two_senders"] += 1
            stream.fault = Sentence("daq.comes_from_two", stream=stream.name)
        age_ns = self.cycle_ns - at_ns
        late = self.late(min(at_ns, self.cycle_ns) if self.led else at_ns, age_ns, LATE_PERIODS)
        self.counts["late"] += late
        for position in stream.positions:
            answers.after_sync_s[position] = -age_ns / NS
        return Quality.INVALID if stream.fault else Quality.LATE if late else Quality.FRESH

    def late(self, at_ns: int, age_ns: float, periods: float) -> bool:
        """Return whether what came at ``at_ns`` is older than so many periods, or of unknown time."""
        if self.context.patience_s > 0:  # machine time stands still meanwhile
            return False
        return age_ns > periods * self.context.period_s * NS or self.port is None or at_ns < self.port.sure_ns

    def alike(self, stream: Stream, answers: Answers) -> None:
        """Take a frame's content: where alternate ones of many belong together, two devices send them."""
        if stream.pace.mixed([answers.raw[position] for position in stream.positions]):
            self.counts["two_senders"] += 1
            stream.fault = Sentence("daq.comes_from_two", stream=stream.name)
            for position in stream.positions:
                answers.value(position, math.nan, Quality.INVALID)

    def _devices(self) -> list[str]:
        return list(dict.fromkeys(stream.device for stream in self.streams))

    def _look(self) -> None:
        for device in self._devices():
            silent = bool(self._lacking(device))
            name = f"{self.config.name}/{device}"
            if silent and device not in self._silent:
                self._silent.add(device)
                self.context.events.begin(name, "silent", self._line(device))
            elif device in self._silent and not silent:
                self._silent.discard(device)
                self.context.events.end(name, "silent")

    def _lacking(self, device: str) -> list[str]:
        """Return the names of the device's streams that do not come."""
        return [
            stream.name
            for stream in self.streams
            if stream.device == device
            and (stream.at_ns is None or self._received_ns - stream.at_ns > max(SILENT_S * NS, 3 * stream.interval_ns))
        ]

    def _line(self, device: str) -> str:
        if device in self._silent:
            lacking = ", ".join(self._lacking(device))
            return Sentence("daq.bus_not_come", config=self.config.name, device=device, lacking=lacking)
        faults = [stream.fault for stream in self.streams if stream.device == device and stream.fault]
        return faults[0] if faults else self.device_line(device)

    def devices(self, failure: str) -> Iterable[DeviceStatus]:
        """Return the state of every device that is listened to."""
        for device in self._devices():
            state = "failed" if failure else "silent" if device in self._silent else "running"
            yield DeviceStatus(device, state, failure or self._line(device))
