"""The recordings of a recalibration: normal operation, or the standard motion.

No request reaches an actuator: the simulated machine's controller gets the motion as a file, as it would from a
person; on a real machine a person lets the arm's own controller follow it and records.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from server.jobs.job_kinds import JobError, StageRun
from server.platform.errors import ConflictError, UnavailableError
from server.recalibrations.recalibration_store import Recalibration, Recalibrations
from server.recordings.recording_store import RecordingRow, Recordings

#: Of normal operation, share that is fitted; the rest is what the fit is judged by.
FITTED = 2 / 3
#: A recording that got less than this share of its time is made again.
ENOUGH = 0.9
#: Times that it is made: its acquisition may die, and comes back.
TRIES = 5
LOOK_S = 0.5
#: s that a recording is shorter than its motion: it begins a moment later, and afterwards the rods may be pinned.
MARGIN_S = 1.0
#: Shares of a recording at which a person is told how far it is.
_TOLD = 20


class Controller(Protocol):
    """The simulated machine's own controller."""

    def send(self, name: str, excitation: str) -> None:
        """Hand it the motion of an excitation under a name."""

    def send_file(self, name: str, motion: Path) -> None:
        """Hand it a motion file under a name."""

    def follows(self, name: str) -> bool:
        """Whether it began to follow it; UnavailableError if it refused."""


class RecalibratedMachines(Protocol):
    """The machines, as a recalibration needs them."""

    def start_recording(self, machine: str, role: str, label: str, seconds: float) -> RecordingRow:
        """Start recording; ConflictError or UnavailableError while that cannot be."""

    def stop_recording(self, id: str) -> None:
        """Stop it."""

    def controller(self, machine: str) -> Controller | None:
        """Of the simulated machine; None: it is a real one."""

    def motion_seconds(self, excitation: str) -> float:
        """Length of a designed motion; JobError if there is none."""

    def rate_hz(self, machine: str) -> float:
        """Cycles a second."""

    def now(self) -> str:
        """The time as the store writes it."""


def record(
    run: StageRun,
    this: Recalibration,
    machines: RecalibratedMachines,
    recordings: Recordings,
    store: Recalibrations,
    pause: Callable[[float], Any],
) -> dict[str, str] | None:
    """Record what a recalibration needs, or wait for whoever does; ids by role, None if told to stop.

    Raises
    ------
    JobError
        If it cannot be recorded before the deadline.
    """
    asked = this.asked
    if asked is None:
        asked = machines.now()
        store.note(this.id, asked=asked)
    deadline = later(asked, this.plan.deadline_s)
    wanted = _wanted(this, machines)
    controller = machines.controller(this.machine)
    if this.plan.motion == "standard" and controller is None:
        return _by_a_person(run, this, machines, recordings, store, pause, asked, deadline)
    found = dict(this.recordings)
    scene = Scene(run, machines, recordings, store, pause, deadline)
    for number, (role, seconds, excitation) in enumerate(wanted):
        send = None
        if excitation is not None and controller is not None:
            send = partial(controller.send, excitation=excitation)
        said = _Said(run, number / len(wanted), 1 / len(wanted))
        if not make(scene, this, found, Wanted(role, role, seconds, send), said):
            return None
    return found


@dataclass(frozen=True)
class Wanted:
    """A recording to make.

    Attributes
    ----------
    key : what it is called among the recordings of the recalibration
    role, seconds : of the recording
    send : hands the simulated machine's controller its motion under a name; None: the machine does what it does
    """

    key: str
    role: str
    seconds: float
    send: Callable[[str], None] | None


@dataclass(frozen=True)
class Scene:
    """Where recordings are made, and until when."""

    run: StageRun
    machines: RecalibratedMachines
    recordings: Recordings
    store: Recalibrations
    pause: Callable[[float], Any]
    deadline: str


def make(
    scene: Scene, this: Recalibration, found: dict[str, str], wanted: Wanted, said: Callable[[float, str], None]
) -> bool:
    """Make one recording, again if it was cut, and note it in ``found`` and in the store; False if told to stop.

    Raises
    ------
    JobError
        If it cannot be recorded before the deadline.
    """
    run, machines, recordings, pause = scene.run, scene.machines, scene.recordings, scene.pause
    rows = wanted.seconds * machines.rate_hz(this.machine)
    if wanted.key in found and _whole(recordings.get(found[wanted.key]), rows):
        return True
    for attempt in range(1, TRIES + 1):
        if wanted.send is not None and not _following(scene, this, wanted, said):
            return False
        begun = _started(run, this, machines, wanted.role, wanted.seconds, scene.deadline, said, pause)
        if begun is None:
            return False
        found[wanted.key] = begun.id
        scene.store.note(this.id, recordings=dict(found))
        ended = _until_sealed(run, machines, recordings, begun.id, wanted.seconds, said, pause)
        if ended is None:
            return False
        if _whole(ended, rows):
            break
        reason = ended.error or f"recording {ended.id} ended early"
        if attempt == TRIES:
            raise JobError(f"{reason}, {TRIES} times over; check the machine and run the schedule again")
        said(0.0, f"Recording again: {reason}")
        pause(LOOK_S)
        _in_time(machines, scene.deadline, reason)
    return True


def _following(scene: Scene, this: Recalibration, wanted: Wanted, said: Callable[[float, str], None]) -> bool:
    """Hand the controller the motion and wait until it follows it; False if told to stop."""
    machines = scene.machines
    controller = machines.controller(this.machine)
    if controller is None or wanted.send is None:
        return True
    name = f"{this.id}-{wanted.key}-{machines.now().replace(':', '')}"
    wanted.send(name)
    while not controller.follows(name):
        if scene.run.should_stop():
            return False
        _in_time(machines, scene.deadline, "the simulated controller did not begin the motion")
        said(0.0, "The arm moves to the start of the motion")
        scene.pause(LOOK_S)
    return True


def _wanted(this: Recalibration, machines: RecalibratedMachines) -> list[tuple[str, float, str | None]]:
    """Role, seconds of machine time and excitation of each recording."""
    if this.plan.motion == "operation":
        fitted = this.plan.duration_s * FITTED
        return [("operation", fitted, None), ("validate", this.plan.duration_s - fitted, None)]
    if not this.plan.excitations:
        raise JobError("the schedule names no excitation for its standard motion; add one to it")
    train, validate = this.plan.excitations[0], this.plan.excitations[-1]
    return [
        ("train", machines.motion_seconds(train) - MARGIN_S, train),
        ("validate", machines.motion_seconds(validate) - MARGIN_S, validate),
    ]


class _Said:
    """Tells progress of one of several recordings, and the same only once."""

    def __init__(self, run: StageRun, start: float, share: float) -> None:
        self._run = run
        self._start = start
        self._share = share
        self._last: tuple[int, str] = (-1, "")

    def __call__(self, fraction: float, text: str) -> None:
        now = (round(fraction * _TOLD), text)
        if now != self._last:
            self._last = now
            self._run.progress(self._start + self._share * fraction, text)


def _started(
    run: StageRun,
    this: Recalibration,
    machines: RecalibratedMachines,
    role: str,
    seconds: float,
    deadline: str,
    said: Callable[[float, str], None],
    pause: Callable[[float], Any],
) -> RecordingRow | None:
    """A recording that has begun; None if told to stop. Waits while the machine is not there or is being recorded."""
    while True:
        try:
            return machines.start_recording(this.machine, role, f"{this.label}: {role}", seconds)
        except (ConflictError, UnavailableError) as error:
            _in_time(machines, deadline, str(error))
            said(0.0, f"Waiting: {error}")
        if run.should_stop():
            return None
        pause(LOOK_S)


def _until_sealed(
    run: StageRun,
    machines: RecalibratedMachines,
    recordings: Recordings,
    id: str,
    seconds: float,
    said: Callable[[float, str], None],
    pause: Callable[[float], Any],
) -> RecordingRow | None:
    """The recording once it is over, however long it became; None if told to stop."""
    waited = 0.0
    while (row := recordings.get(id)).state == "recording":
        if run.should_stop():
            machines.stop_recording(id)
            return None
        said(min(waited / seconds, 1.0), f"Recording {row.role} for {seconds:.0f} s")
        pause(LOOK_S)
        waited += LOOK_S
    return None if run.should_stop() else row


def _whole(row: RecordingRow, rows: float) -> bool:
    """Whether a recording is sealed and has nearly as many rows as it should."""
    counted = row.statistics.get("rows")
    return row.state == "sealed" and counted is not None and counted >= ENOUGH * rows


def _by_a_person(
    run: StageRun,
    this: Recalibration,
    machines: RecalibratedMachines,
    recordings: Recordings,
    store: Recalibrations,
    pause: Callable[[float], Any],
    asked: str,
    deadline: str,
) -> dict[str, str] | None:
    """Wait until somebody recorded the motion as train and as validate since it was asked for."""
    motions = " and ".join(dict.fromkeys(this.plan.excitations))
    said = _Said(run, 0.0, 1.0)
    while True:
        found = {}
        for role in ("train", "validate"):
            rows = recordings.list(1, machine=this.machine, role=role, state="sealed").items
            if rows and rows[0].created >= asked:
                found[role] = rows[0].id
        if len(found) == 2:
            store.note(this.id, recordings=found)
            return found
        missing = " and ".join(f"'{role}'" for role in ("train", "validate") if role not in found)
        text = f"load the motion of {motions} into the arm's controller, and record it as {missing}"
        said(len(found) / 2, f"Waiting for a person until {deadline[:16]} UTC: {text}")
        if run.should_stop():
            return None
        _in_time(machines, deadline, f"nobody recorded the standard motion as {missing}; run the schedule again")
        pause(LOOK_S)


def later(time: str, seconds: float) -> str:
    """A time of the store, seconds later."""
    moved = datetime.fromisoformat(time) + timedelta(seconds=seconds)
    return moved.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _in_time(machines: RecalibratedMachines, deadline: str, text: str) -> None:
    if machines.now() > deadline:
        raise JobError(f"until {deadline[:16]} UTC {text}")
