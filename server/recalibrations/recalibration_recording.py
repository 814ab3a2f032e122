"""The recordings of a recalibration: normal operation, or the standard motion.

No request reaches an actuator: the simulated machine's controller gets the motion as a file, as it would from a
person; on a real machine a person lets the arm's own controller follow it and records.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from daq.messages import Sentence
from server.jobs.job_kinds import JobError, StageRun
from server.platform.database.engine import later
from server.platform.errors import ConflictError, UnavailableError
from server.recalibrations.recalibration_site import Site
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
#: Shares of a recording at which its progress is stored.
_STEPS = 20


@dataclass(frozen=True)
class RecordedStage:
    """The stage of one recalibration that records, or waits for whoever does.

    Attributes
    ----------
    store : knows what was recorded so far
    pause : waits that many seconds
    """

    run: StageRun
    this: Recalibration
    machines: Site
    recordings: Recordings
    store: Recalibrations
    pause: Callable[[float], Any]

    def record(self) -> dict[str, str] | None:
        """Record them: ids of recordings by role, None if ordered to stop.

        Raises
        ------
        JobError
            If it cannot be recorded before the deadline.
        """
        asked = self.this.asked
        if asked is None:
            asked = self.machines.now()
            self.store.note(self.this.id, asked=asked)
        deadline = later(asked, timedelta(seconds=self.this.plan.deadline_s))
        wanted = _wanted(self.this, self.machines)
        controller = self.machines.controller(self.this.machine)
        if self.this.plan.motion == "standard" and controller is None:
            return self._by_a_person(asked, deadline)
        found, rate_hz = dict(self.this.recordings), self.machines.rate_hz(self.this.machine)
        for number, (role, seconds, excitation) in enumerate(wanted):
            if role in found and _whole(self.recordings.get(found[role]), seconds * rate_hz):
                continue
            progress = _Progress(self.run, number / len(wanted), 1 / len(wanted))
            for attempt in range(1, TRIES + 1):
                if excitation is not None and controller is not None:
                    name = f"{self.this.id}-{role}-{self.machines.now().replace(':', '')}"
                    controller.send(name, excitation)
                    while not controller.follows(name):
                        if self.run.should_stop():
                            return None
                        self._in_time(deadline, Sentence("server.motion_not_begun"))
                        progress(0.0, Sentence("server.arm_moves_start_motion"))
                        self.pause(LOOK_S)
                begun = self._started(role, seconds, deadline, progress)
                if begun is None:
                    return None
                found[role] = begun.id
                self.store.note(self.this.id, recordings=found)
                ended = self._until_sealed(begun.id, seconds, progress)
                if ended is None:
                    return None
                if _whole(ended, seconds * rate_hz):
                    break
                reason = (
                    ended.sentence("error") if ended.error else Sentence("server.recording_ended_early", ended=ended.id)
                )
                if attempt == TRIES:
                    raise JobError("server.times_over", reason=reason, tries=TRIES)
                progress(0.0, Sentence("server.recording_again", reason=reason))
                self.pause(LOOK_S)
                self._in_time(deadline, reason)
        return found

    def _started(self, role: str, seconds: float, deadline: str, progress: _Progress) -> RecordingRow | None:
        """Begin a recording; None if ordered to stop. Waits while the machine is away or is being recorded."""
        while True:
            try:
                label = f"{self.this.label}: {role}"
                return self.machines.start_recording(self.this.machine, role, label, seconds)
            except (ConflictError, UnavailableError) as error:
                self._in_time(deadline, str(error))
                progress(0.0, Sentence("server.waiting_as", why=str(error)))
            if self.run.should_stop():
                return None
            self.pause(LOOK_S)

    def _until_sealed(self, id: str, seconds: float, progress: _Progress) -> RecordingRow | None:
        """Wait for the recording's end, however long it became; None if ordered to stop."""
        waited = 0.0
        while (row := self.recordings.get(id)).state == "recording":
            if self.run.should_stop():
                self.machines.stop_recording(id)
                return None
            progress(min(waited / seconds, 1.0), Sentence("server.recording_for", role=row.role, seconds=seconds))
            self.pause(LOOK_S)
            waited += LOOK_S
        return None if self.run.should_stop() else row

    def _by_a_person(self, asked: str, deadline: str) -> dict[str, str] | None:
        """Wait until somebody recorded the motion as train and as validate since it was asked for."""
        motions = list(dict.fromkeys(self.this.plan.excitations))
        progress = _Progress(self.run, 0.0, 1.0)
        while True:
            found = {}
            for role in ("train", "validate"):
                rows = self.recordings.list(1, machine=self.this.machine, role=role, state="sealed").items
                if rows and rows[0].created >= asked:
                    found[role] = rows[0].id
            if len(found) == 2:
                self.store.note(self.this.id, recordings=found)
                return found
            missing = [f"'{role}'" for role in ("train", "validate") if role not in found]
            text = Sentence("server.load_motion", motions=motions, missing=missing)
            progress(len(found) / 2, Sentence("server.waiting_for_person", deadline=deadline[:16], text=text))
            if self.run.should_stop():
                return None
            self._in_time(deadline, Sentence("server.nobody_recorded", missing=missing))
            self.pause(LOOK_S)

    def _in_time(self, deadline: str, text: str) -> None:
        if self.machines.now() > deadline:
            raise JobError("server.until_utc", deadline=deadline[:16], text=text)


def _wanted(this: Recalibration, machines: Site) -> list[tuple[str, float, str | None]]:
    """List role, seconds of machine time and excitation of each recording."""
    if this.plan.motion == "operation":
        fitted = this.plan.duration_s * FITTED
        return [("operation", fitted, None), ("validate", this.plan.duration_s - fitted, None)]
    if not this.plan.excitations:
        raise JobError("server.schedule_names_no_excitation")
    train, validate = this.plan.excitations[0], this.plan.excitations[-1]
    return [
        ("train", machines.motion_seconds(train) - MARGIN_S, train),
        ("validate", machines.motion_seconds(validate) - MARGIN_S, validate),
    ]


class _Progress:
    """Reports progress of one of several recordings, and the same only once."""

    def __init__(self, run: StageRun, start: float, share: float) -> None:
        self._run = run
        self._start = start
        self._share = share
        self._last: tuple[int, str] = (-1, "")

    def __call__(self, fraction: float, text: str) -> None:
        now = (round(fraction * _STEPS), text)
        if now != self._last:
            self._last = now
            self._run.progress(self._start + self._share * fraction, text)


def _whole(row: RecordingRow, rows: float) -> bool:
    """Test whether a recording is sealed and has nearly as many rows as it should."""
    counted = row.statistics.get("rows")
    return row.state == "sealed" and counted is not None and counted >= ENOUGH * rows
