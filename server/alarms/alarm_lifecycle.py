"""What can happen to an alarm. Pure functions from one state to the next; time is an argument.

::

            raise_             clear
    (none) -------> active -----------> cleared --(acknowledged: a new one next time)
                      |  ^                  |
                      |  '------raise_------'  not acknowledged: the same alarm, one more in ``count``
                      '-- acknowledge, shelve, unshelve at any time; a shelf ends by itself
"""

from __future__ import annotations

import hashlib
from datetime import datetime, timedelta
from typing import Annotated, Literal

from server.alarms.alarm_conditions import Severity
from server.platform.database.engine import as_stored
from server.platform.database.stored import Id, Kept, Stored
from server.platform.http.bodies import Message

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
