"""Keeps one acquisition process per machine alive, and reads its ring buffer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, suppress
from dataclasses import KW_ONLY, asdict, dataclass, field
from pathlib import Path
from typing import Any

import structlog

from daq import Machine, Quality, load_machine
from daq.acquisition.acquisition import AcquisitionProcess
from daq.errors import HilfitError
from daq.machine.bus_places import is_listed
from daq.messages import Sentence, message_of, with_their_messages
from server.platform.errors import ConflictError, UnavailableError
from server.platform.http.bodies import finite

#: Seconds between two looks at a running acquisition.
LOOK_S = 0.5
#: Seconds that commissioning may take before the attempt is given up.
START_S = 60.0
START_LOOK_S = 0.1
#: Seconds before the next attempt: doubled after each that failed, up to the last.
FIRST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 30.0
_log = structlog.stdlib.get_logger(__name__)


#: Starts acquiring a machine; leaving the context ends it.
Launch = Callable[[Machine], AbstractContextManager[AcquisitionProcess]]


@dataclass
class _State:
    """State that the supervisor's thread shares with the others, under its lock."""

    state: str = "starting"  # starting, running, waiting, stopped
    error: str | None = None
    restarts: int = 0
    feed: AcquisitionProcess | None = None
    machine: Machine | None = None
    last: dict[str, Any] = field(default_factory=dict)


@dataclass(eq=False)
class Supervisor:
    """One machine: starts its acquisition, starts it again when it dies, with growing pauses.

    Attributes
    ----------
    places : where it may go (:mod:`daq.machine.bus_places`); None: wherever its file says
    pause : waits that many seconds or until ordered to stop; True if so (a test passes its own)
    """

    name: str
    machine_file: Path
    launch: Launch
    _: KW_ONLY
    places: Collection[str] | None = None
    changed: Callable[[], None] = lambda: None
    pause: Callable[[threading.Event, float], bool] = lambda event, seconds: event.wait(seconds)

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._state = _State()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"acquisition-{self.name}", daemon=True)

    def start(self) -> None:
        """Start the supervising thread; returns at once."""
        self._thread.start()

    def stop(self) -> None:
        """End the acquisition and wait for it."""
        self._stop.set()
        self._thread.join()

    @property
    def running(self) -> tuple[Machine, AcquisitionProcess] | None:
        """The machine and its feed while frames come, else None."""
        with self._lock:
            state = self._state
            if state.state != "running" or state.feed is None or state.machine is None:
                return None
            return state.machine, state.feed

    def statistics(self) -> dict[str, Any]:
        """Return state, restarts, the last error, and what the process counted."""
        with self._lock:
            state = self._state
            error = {"error": state.error, "error_message": message_of(state.error)}
            result = {"state": state.state, "restarts": state.restarts, **error}
            return result if not state.last else {**result, "counts": state.last}

    def _set(self, **values: Any) -> None:
        with self._lock:
            for key, value in values.items():
                setattr(self._state, key, value)
        if "state" in values:
            self.changed()

    def _run(self) -> None:
        failures = 0
        while not self._stop.is_set():
            self._set(state="starting")
            ran = False
            try:
                machine = load_machine(self.machine_file)
                _refuse_elsewhere(machine, self.places)
                with self.launch(machine) as feed:
                    if self._comes_up(feed):
                        ran = True
                        self._set(state="running", error=None, feed=feed, machine=machine)
                        _log.info("acquisition_running", machine=self.name)
                        self._watch(feed)
                        self._set(state="stopped", feed=None)
            except HilfitError as error:
                self._failed(str(error))
            except Exception as error:  # a driver may raise anything; the machine has to come back all the same
                _log.error("acquisition_failed", machine=self.name, exc_info=error)
                self._failed(Sentence("server.acquisition_failed_unexpectedly"))
            if self._stop.is_set():
                break
            failures = 1 if ran else failures + 1
            if self.pause(self._stop, min(FIRST_PAUSE_S * 2 ** (failures - 1), LONGEST_PAUSE_S)):
                break
            with self._lock:
                self._state.restarts += 1
        self._set(state="stopped", feed=None)

    def _failed(self, error: str) -> None:
        self._set(state="waiting", error=error, feed=None)
        _log.warning("acquisition_waits", machine=self.name, error=error)

    def _comes_up(self, feed: AcquisitionProcess) -> bool:
        """Wait until frames come; False if ordered to stop before."""
        for _ in range(round(START_S / START_LOOK_S)):
            if feed.alive:
                return True
            feed.check()
            if self.pause(self._stop, START_LOOK_S):
                return False
        raise UnavailableError("server.no_frame_came_within", start_s=START_S)

    def _watch(self, feed: AcquisitionProcess) -> None:
        """Return when ordered to stop; raise when the process has died."""
        while not self.pause(self._stop, LOOK_S):
            self._set(last=with_their_messages(asdict(feed.statistics())))
            if not feed.alive:
                feed.check()
                raise UnavailableError("server.acquisition_process_ended_itself")


def _refuse_elsewhere(machine: Machine, places: Collection[str] | None) -> None:
    """Raise ConflictError if a bus of a machine leads to a place that is not among ``places`` (None: all are)."""
    for bus in machine.buses if places is not None else ():
        place = bus.place
        if not is_listed(place, places or ()):
            raise ConflictError("server.machine_cannot_acquired_bus", machine=machine.name, bus=bus.name, place=place)


class Acquisition:
    """All machines that are acquired.

    Parameters
    ----------
    launch : starts acquiring one machine
    changed : called whenever a machine's acquisition changes its state
    places : where machines of others may go (:mod:`daq.machine.bus_places`)
    """

    def __init__(self, launch: Launch, changed: Callable[[], None], places: Collection[str]) -> None:
        self._launch = launch
        self._places = places
        self._changed = changed
        self._lock = threading.Lock()
        self._supervisors: dict[str, Supervisor] = {}

    def start(self, name: str, machine_file: Path, own: bool = False) -> None:
        """Acquire machine ``name``, from now on by this file; one of our ``own`` goes wherever it is led."""
        self.stop(name)
        places = None if own else self._places
        supervisor = Supervisor(name, machine_file, self._launch, places=places, changed=self._changed)
        with self._lock:
            self._supervisors[name] = supervisor
        supervisor.start()

    def stop(self, name: str) -> None:
        """Stop acquiring machine ``name``; nothing happens if it is not acquired."""
        with self._lock:
            supervisor = self._supervisors.pop(name, None)
        if supervisor is not None:
            supervisor.stop()

    def stop_all(self) -> None:
        """Stop acquiring anything."""
        for name in self.names():
            self.stop(name)

    def names(self) -> tuple[str, ...]:
        """Name the machines that are acquired (or should be, while one starts)."""
        with self._lock:
            return tuple(self._supervisors)

    def _supervisor(self, name: str) -> Supervisor | None:
        with self._lock:
            return self._supervisors.get(name)

    def running(self, name: str) -> bool:
        """Test whether frames of that machine come at the moment."""
        supervisor = self._supervisor(name)
        return supervisor is not None and supervisor.running is not None

    def check(self, machine_file: Path, own: bool = False) -> None:
        """Raise ConflictError if a machine's file does not name where its channels come from, or leads elsewhere."""
        machine = load_machine(machine_file)
        silent = [channel.name for channel in machine.channels if channel.source is None]
        if not machine.buses or silent:
            lacking = Sentence("server.channel_no_source", channel=silent[0]) if silent else Sentence("server.no_buses")
            raise ConflictError("server.machine_cannot_acquired_file", machine=machine.name, what=lacking)
        _refuse_elsewhere(machine, None if own else self._places)

    def statistics(self, name: str) -> dict[str, Any]:
        """Return the state of one machine's acquisition."""
        supervisor = self._supervisor(name)
        return {"state": "off"} if supervisor is None else supervisor.statistics()

    def state(self, name: str) -> str:
        """Return one machine's acquisition state: ``off``, ``starting``, ``running``, ``waiting``, ``stopped``."""
        return str(self.statistics(name)["state"])

    def feed(self, name: str) -> tuple[Machine, AcquisitionProcess]:
        """Return the machine and its running feed.

        Raises
        ------
        ConflictError
            If it is not acquired, or that is starting.
        UnavailableError
            If its acquisition does not run at the moment.
        """
        supervisor = self._supervisor(name)
        if supervisor is None:
            raise ConflictError("server.machine_not_being_acquired", name=name).about("not_acquired", machine=name)
        running = supervisor.running
        if running is None:
            found = supervisor.statistics()
            state, error = found["state"], found["error"]
            why = Sentence("server.in_brackets", what=error) if error else ""
            kind = ConflictError if state == "starting" else UnavailableError  # no fault of the service, and soon over
            refusal = kind("server.acquisition_of_machine_is", name=name, state=state, why=why)
            raise refusal.about(f"acquisition_{state}", machine=name)
        return running

    def latest(self, name: str) -> dict[str, Any]:
        """Return the newest frame: values in the channels' units, quality and age; NaN becomes None."""
        from daq.acquisition.ring import RingReader
        from daq.frames.frame import frame_from_row

        machine, feed = self.feed(name)
        with RingReader(feed.ring_name) as reader:
            row = reader.latest()
        if row is None:
            raise ConflictError("server.machine_not_sent_frame", name=name).about("acquisition_starting", machine=name)
        frame = frame_from_row(row[0])
        channels = {}
        for index, channel in enumerate(machine.channels):
            value = float(machine.conversion(channel).from_si(float(frame.values[index])))
            channels[channel.name] = {
                "value": finite(value),
                "unit": channel.unit,
                "quality": Quality(int(frame.quality[index])).name.lower(),
                "age_s": finite(frame.ages[index]),
            }
        return {"cycle": frame.cycle, "time": frame.time, "utc_ns": frame.utc_ns, "channels": channels}

    def newest(self, name: str | None) -> dict[str, dict[str, Any]]:
        """Return the newest frame of one machine, or of each that has one, by machine."""
        if name is not None:
            return {name: self.latest(name)}
        found = {}
        for machine in self.names():
            with suppress(ConflictError, UnavailableError):  # starting, waiting, or stopped just now
                found[machine] = self.latest(machine)
        return found
