"""Events of devices and buses while acquisition ran: when, to which, what, for how long.

Events travel in the ring's information text, of which a recorder keeps what falls into its recording. So the list that
is published is short (:data:`PUBLISHED`), each event has a number of its own, and whoever reads too rarely sees by a
gap in the numbers that some are gone. The same thing that happens again within :data:`MERGED_S` is counted in the event
that is there: a storm of messages is one line with a count, while the counters of the driver count every one.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from daq.messages import Sentence, message_of

PUBLISHED = 64
TEXT_LENGTH = 240  # characters; with 64 of them the published list stays below a third of what the ring has room for
MERGED_S = 1.0


@dataclass
class Event:
    """One thing that happened.

    Attributes
    ----------
    number : counts up over all events of an acquisition
    utc_ns : when it began, ns since 1970
    device : what it happened to, as ``bus/device``, or the bus itself
    what : short name: ``silent``, ``failed``, ``boot_up``, ``emergency``, ``bus_off``, ...
    text : one line
    seconds : how long it lasted; None for something that still lasts; 0 for a moment
    count : how often it was seen within it
    message : code and values of the text
    """

    number: int
    utc_ns: int
    device: str
    what: str
    text: str
    seconds: float | None = 0.0
    count: int = 1
    message: dict[str, Any] | None = None


class EventLog:
    """Collects events from all threads of an acquisition.

    Parameters
    ----------
    utc_ns, monotonic_ns : the clocks
    """

    def __init__(
        self, utc_ns: Callable[[], int] = time.time_ns, monotonic_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._utc_ns = utc_ns
        self._monotonic_ns = monotonic_ns
        self._lock = threading.Lock()
        self._events: deque[Event] = deque(maxlen=PUBLISHED)
        self._open: dict[tuple[str, str], tuple[Event, int]] = {}  # and when it began, monotonic
        self._last: dict[tuple[str, str], tuple[Event, int]] = {}  # and when it was seen last
        self._count = 0

    def note(self, device: str, what: str, text: str, count: int = 1) -> None:
        """Note an event without length, seen ``count`` times."""
        now = self._monotonic_ns()
        with self._lock:
            event, seen = self._last.get((device, what), (None, 0))
            if event is not None and now - seen <= MERGED_S * 1e9:
                event.count += count
            else:
                event = self._add(device, what, text, 0.0)
                event.count = count
            self._last[device, what] = event, now

    def begin(self, device: str, what: str, text: str) -> None:
        """Begin an event that lasts until :meth:`end`; repeats meanwhile are counted."""
        with self._lock:
            if (device, what) in self._open:
                self._open[device, what][0].count += 1
                return
            self._open[device, what] = self._add(device, what, text, None), self._monotonic_ns()

    def end(self, device: str, what: str) -> float | None:
        """End it; return how long it lasted in s, None if it had not begun."""
        with self._lock:
            event, began = self._open.pop((device, what), (None, 0))
            if event is None:
                return None
            event.seconds = (self._monotonic_ns() - began) / 1e9
            if event not in self._events:  # it began so long ago that it is not published any more: say its end
                self._events.append(event)
            return event.seconds

    def _add(self, device: str, what: str, text: str, seconds: float | None) -> Event:
        self._count += 1
        event = Event(self._count, self._utc_ns(), device, what, " ".join(text.split())[:TEXT_LENGTH], seconds)
        event.message = message_of(text)
        self._events.append(event)
        if len(self._last) > 4 * PUBLISHED:
            self._last.clear()
        return event

    def published(self) -> list[dict[str, Any]]:
        """Return the newest events, oldest first, as JSON can carry them, with all that last on."""
        with self._lock:
            lasting = {event.number: event for event, _ in self._open.values()}
            others = {event.number: event for event in self._events if event.number not in lasting}
            kept = sorted(lasting)[-PUBLISHED:]
            kept += sorted(others)[len(kept) - PUBLISHED :] if len(kept) < PUBLISHED else []
            return [asdict((lasting | others)[number]) for number in sorted(kept)]


def events_path(recording: Path) -> Path:
    """Return the path of a recording's events beside it."""
    return recording.with_name(recording.name + ".events.json")


class RecordedEvents:
    """Events that fall into a recording; also in a file beside it, rewritten whenever there is something new."""

    def __init__(self, recording: Path) -> None:
        self._path = events_path(recording)
        self._events: dict[int, dict[str, Any]] = {}
        self._newest: int | None = None  # event that was there when the recording began
        self.warning = ""

    @property
    def listed(self) -> list[dict[str, Any]]:
        """The events, oldest first."""
        return [self._events[number] for number in sorted(self._events)]

    def take(self, published: Iterable[dict[str, Any]], first_utc_ns: int | None) -> None:
        """Keep what lasts on when the recording begins, what happened since, and how long what is known lasted."""
        if first_utc_ns is None:
            return
        published = list(published)
        if self._newest is None:
            self._newest = max((event["number"] for event in published), default=0)
        before = [dict(event) for event in self.listed]
        for event in published:
            began, seconds, number = event["utc_ns"], event["seconds"], event["number"]
            during = seconds is None or began + seconds * 1e9 >= first_utc_ns
            # By its number as well: who sets the computer's clock back must not make later events earlier ones.
            if during or number > self._newest or number in self._events:
                self._events[number] = event
        if self.listed == before:
            return
        # Whatever reads and writes recordings; the acquisition process, which only keeps a log, has no use for it.
        from daq.whole_files import replacing

        try:
            with replacing(self._path) as temporary:
                temporary.write_text(json.dumps(self.listed, indent=1) + "\n", encoding="utf-8")
        except OSError as error:  # the recording is what matters; its metadata will have the events
            self.warning = Sentence("daq.not_writable", trace=self._path, error=error.strerror)
