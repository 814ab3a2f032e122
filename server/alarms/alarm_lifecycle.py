"""Conditions of alarms, and the life of an alarm. Pure functions; time is an argument.

The words are those of ISA-18.2 (IEC 62682): an alarm comes on when its condition has held for the on-delay, and goes
when the condition has been gone for the off-delay. A condition on a measured value has a dead-band: it comes above one
limit and goes below a lower one, so that noise about the limit is one alarm and not a hundred.

::

            raise_             clear
    (none) -------> active -----------> cleared --(acknowledged: a new one next time)
                      |  ^                  |
                      |  '------raise_------'  not acknowledged: the same alarm, one more in ``count``
                      '-- acknowledge, shelve, unshelve at any time; a shelf ends by itself
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Annotated, Literal

from server.platform.database.engine import as_stored
from server.platform.database.stored import Id, Kept, Stored
from server.platform.http.bodies import Message

Severity = Literal["info", "warning", "critical"]


@dataclass(frozen=True)
class AlarmKind:
    """Rules by which alarms of one kind come and go.

    Attributes
    ----------
    on_delay_s, off_delay_s : s that the condition has to hold, or to be gone
    """

    on_delay_s: float = 0.0
    off_delay_s: float = 0.0


#: All kinds. Acquisition may take some seconds to come up and a restart of it is no news; a telegram that is lost is
#: none either. What another part has already thought about (a drift, a failed job) has no delay.
KINDS: dict[str, AlarmKind] = {
    "acquisition_down": AlarmKind(on_delay_s=15.0, off_delay_s=2.0),
    "channel_stale": AlarmKind(on_delay_s=3.0, off_delay_s=5.0),
    "disk_full": AlarmKind(on_delay_s=0.0, off_delay_s=10.0),
    "clock_jumped": AlarmKind(),
    "residual_drift": AlarmKind(),
    "valve_drift": AlarmKind(),
    "overload": AlarmKind(),
    "residual_grew": AlarmKind(),
    "recalibration_failed": AlarmKind(),
    "worker_silent": AlarmKind(),
    "store_damaged": AlarmKind(),
    "audit_cut": AlarmKind(),
    "backup_failed": AlarmKind(),
    "webhook_failed": AlarmKind(),
}


@dataclass(frozen=True)
class Timer:
    """A condition between its two delays.

    Attributes
    ----------
    on : whether it counts as wrong
    since : s, when the condition began to differ from ``on``; None while it agrees
    """

    on: bool = False
    since: float | None = None


def step(timer: Timer, kind: AlarmKind, condition: bool, now: float) -> Timer:
    """Step the timer by a look at the condition at ``now`` (s, a clock that never jumps)."""
    if condition == timer.on:
        return timer if timer.since is None else replace(timer, since=None)
    since = now if timer.since is None else timer.since
    delay = kind.on_delay_s if condition else kind.off_delay_s
    return Timer(on=condition) if now - since >= delay else Timer(timer.on, since)


@dataclass(frozen=True)
class DeadBand:
    """Limits of a measured value.

    Attributes
    ----------
    comes, goes : the condition comes at a value of ``comes`` or beyond and goes at ``goes`` or before; ``goes`` above
        ``comes`` is a condition that comes when the value is small
    """

    comes: float
    goes: float


def beyond(value: float, limits: DeadBand, was: bool) -> bool:
    """Test whether the condition holds, given whether it did; a value that is not a number changes nothing."""
    rising = limits.goes <= limits.comes
    sign = 1.0 if rising else -1.0
    if sign * value >= sign * limits.comes:
        return True
    if sign * value <= sign * limits.goes:
        return False
    return was


#: Longest time that an alarm may be shelved: nobody should forget one over a change of shift and the next.
LONGEST_SHELF_S = 86400


class Alarm(Stored, table="alarms", noun="alarm", created="raised", label="text"):
    """One alarm; times are ISO 8601 in UTC.

    Attributes
    ----------
    machine : None for one of the service as a whole
    count : how often it came before somebody acknowledged it
    raised, cleared : the last time that it came and went
    shelved_until : it is tracked but nobody is to be called before then; None if it is not shelved
    """

    id: Id
    machine: Annotated[str | None, Kept(index=True)]
    kind: str
    text: str
    text_message: Message | None = None
    severity: Severity
    state: Literal["active", "cleared"] = "active"
    acknowledged: bool = False
    acknowledged_by: str | None = None
    shelved_until: str | None = None
    shelved_by: str | None = None
    shelve_reason: str | None = None
    raised: str
    cleared: str | None = None
    count: int = 1


def tag(alarm: Alarm) -> str:
    """Return a tag that changes with every change of the alarm: for ``ETag``."""
    return hashlib.sha256(repr(alarm).encode()).hexdigest()[:16]


def raise_(last: Alarm | None, new: Alarm) -> Alarm:
    """Raise the condition of ``new``: return the alarm to store.

    Parameters
    ----------
    last : the newest alarm of that machine and kind, if there ever was one
    new : what it would be as a new one

    Returns
    -------
    ``last`` with a new text if it is active; ``last`` active once more if nobody acknowledged it; else ``new``, on the
    shelf on which ``last`` still is.
    """
    if last is None:
        return new
    now = {"text": new.text, "text_message": new.text_message, "severity": new.severity}
    if last.state == "active":
        return last.but(**now)
    if not last.acknowledged:
        return last.but(state="active", **now, raised=new.raised, count=last.count + 1)
    return new.but(shelved_until=last.shelved_until, shelved_by=last.shelved_by, shelve_reason=last.shelve_reason)


def clear(alarm: Alarm, now: str) -> Alarm:
    """Clear the condition."""
    return alarm if alarm.state == "cleared" else alarm.but(state="cleared", cleared=now)


def acknowledge(alarm: Alarm, who: str) -> Alarm:
    """Note that somebody has seen it; the first one remains named."""
    return alarm if alarm.acknowledged else alarm.but(acknowledged=True, acknowledged_by=who)


def shelve(alarm: Alarm, who: str, reason: str, seconds: float, now: datetime) -> Alarm:
    """Keep it quiet for ``seconds``, at most :data:`LONGEST_SHELF_S`."""
    until = now + timedelta(seconds=min(seconds, LONGEST_SHELF_S))
    return alarm.but(shelved_until=as_stored(until), shelved_by=who, shelve_reason=reason)


def unshelve(alarm: Alarm) -> Alarm:
    """Take it off the shelf."""
    return alarm.but(shelved_until=None, shelved_by=None, shelve_reason=None)


def expired(alarm: Alarm, now: datetime) -> bool:
    """Test whether its shelf has ended.

    One that would end later than it could have been put there ends too: the clock was set back meanwhile.
    """
    if alarm.shelved_until is None:
        return False
    left = datetime.fromisoformat(alarm.shelved_until) - now
    return not timedelta(0) < left <= timedelta(seconds=LONGEST_SHELF_S)
