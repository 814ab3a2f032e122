"""When the slots of a schedule are: five-field cron expressions in a time zone.

The expression is evaluated on the wall clock, and each wall-clock time is then one moment in UTC. On the day on which
the clock is put back, a time that comes twice counts the first time only; on the day on which it is put forward, a
time that does not exist counts as late as the clock jumped (02:30 becomes 03:30), and if another slot is there
already they are one. So a daily schedule runs once on every day of the year. The price: an hourly schedule has one
slot less on the day with 25 hours.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import takewhile
from zoneinfo import ZoneInfo, available_timezones

from daq.messages import Sentence
from server.platform.errors import InvalidError
from server.schedules.cron import Cron

#: A wall clock can be put back or forward by less than this.
_JUMP = timedelta(hours=3)
#: Slots closer than this make no sense: a recalibration takes minutes.
SHORTEST = timedelta(minutes=5)


def check(cron: str, timezone: str, now: datetime) -> None:
    """Refuse what cannot be a schedule.

    Raises
    ------
    InvalidError
        One line: the time zone is unknown, the expression is none, never comes, or comes too often.
    """
    if timezone not in available_timezones():
        raise InvalidError(Sentence("server.timezone_unknown", timezone=timezone))
    try:
        Cron.parse(cron)
    except ValueError:
        raise InvalidError(Sentence("server.cron_cannot_read", cron=cron)) from None
    following = upcoming(cron, timezone, now)
    first = next(following, None)
    if first is None:
        raise InvalidError(Sentence("server.cron_never_comes", cron=cron))
    for _ in range(12):
        second = next(following, None)
        if second is None:
            return
        if second - first < SHORTEST:
            least = SHORTEST.seconds // 60
            raise InvalidError(Sentence("server.cron_comes_more_often", cron=cron, least=least))
        first = second


def upcoming(cron: str, timezone: str, after: datetime) -> Iterator[datetime]:
    """Yield slots after a moment, in UTC, rising; end where none comes for fifty years, or without expression."""
    zone = ZoneInfo(timezone)
    start = after.astimezone(zone).replace(tzinfo=None) - _JUMP
    try:
        walls = Cron.parse(cron).after(start)
    except ValueError:  # one that was taken before there was a grammar
        return
    last = after
    for local in walls:
        slot = local.replace(tzinfo=zone, fold=0).astimezone(UTC)
        if slot > last:
            last = slot
            yield slot


def due(cron: str, timezone: str, after: datetime, now: datetime, most: int) -> tuple[datetime, ...]:
    """List slots after ``after`` and not later than ``now``, oldest first: the newest ``most``."""
    return tuple(deque(takewhile(lambda slot: slot <= now, upcoming(cron, timezone, after)), maxlen=most))
