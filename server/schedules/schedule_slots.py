"""Slots of a schedule: five-field cron expressions in a time zone.

The expression is evaluated on the wall clock, and each wall-clock time is then one moment in UTC. On the day on which
the clock is put back, a time that comes twice counts the first time only; on the day on which it is put forward, a
time that does not exist counts as late as the clock jumped (02:30 becomes 03:30), and if another slot is there
already they are one. So a daily schedule runs once on every day of the year. The price: an hourly schedule has one
slot less on the day with 25 hours.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from itertools import product, takewhile
from zoneinfo import ZoneInfo, available_timezones

from server.platform.errors import InvalidError

#: Years in which a day has to come that ever comes: two 29th of February on one weekday are 40 apart at most.
YEARS = 50
_MONTHS = {
    name: number
    for number, name in enumerate(
        ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"], 1
    )
}
_DAYS = {name: number for number, name in enumerate(["SUN", "MON", "TUE", "WED", "THU", "FRI", "SAT"])}
_ONE = r"[0-9]{1,2}|[A-Z]{3}"
_PART = re.compile(rf"(?:\*|(?P<first>{_ONE})(?:-(?P<last>{_ONE}))?)(?:/(?P<step>[0-9]{{1,2}}))?")


@dataclass(frozen=True)
class Cron:
    """An expression of five fields: minute, hour, day of the month, month, day of the week.

    ==========================  =============================================================================
    a field is a list of        that means
    ==========================  =============================================================================
    ``*``                       every value
    ``7``, ``JUL``, ``MON``     one; names for months and days of the week only; Sunday is 0 or 7
    ``8-17``                    a range, both ends in it
    ``*/15``, ``8-18/2``        every fifteenth from the first, every second of a range
    ``1,15,28-31``              any of several
    ==========================  =============================================================================

    Where both day fields are given (neither begins with ``*``), a day that fits either counts, otherwise one that fits
    both, as in crontab(5): ``either_day``. There is nothing else: no seconds, no ``@daily``, nothing random, no last
    day, no n-th Monday.
    """

    minutes: tuple[int, ...]
    hours: tuple[int, ...]
    days: frozenset[int]
    months: frozenset[int]
    weekdays: frozenset[int]
    either_day: bool

    @classmethod
    def parse(cls, text: str) -> Cron:
        """Read an expression (ValueError if it is none)."""
        minute, hour, day, month, weekday = text.upper().split()
        return cls(
            minutes=tuple(sorted(_field(minute, 0, 59))),
            hours=tuple(sorted(_field(hour, 0, 23))),
            days=frozenset(_field(day, 1, 31)),
            months=frozenset(_field(month, 1, 12, _MONTHS)),
            weekdays=frozenset(value % 7 for value in _field(weekday, 0, 7, _DAYS)),
            either_day=not day.startswith("*") and not weekday.startswith("*"),
        )

    def after(self, start: datetime) -> Iterator[datetime]:
        """Yield times after ``start``, rising; no time zone. Ends where none comes for :data:`YEARS` years."""
        found, day = start.date(), start.date()
        while (day - found).days < YEARS * 366 and day < date.max:
            if self._fits(day):
                found = day
                for hour, minute in product(self.hours, self.minutes):
                    moment = datetime.combine(day, time(hour, minute))
                    if moment > start:
                        yield moment
            day += timedelta(days=1)

    def _fits(self, day: date) -> bool:
        of_month, of_week = day.day in self.days, day.isoweekday() % 7 in self.weekdays
        return day.month in self.months and ((of_month or of_week) if self.either_day else (of_month and of_week))


def _field(text: str, lowest: int, highest: int, names: Mapping[str, int] | None = None) -> set[int]:
    found: set[int] = set()
    for part in text.split(","):
        matched = _PART.fullmatch(part)
        if matched is None:
            raise ValueError(part)
        first, last, step = matched["first"], matched["last"], matched["step"]
        begin = lowest if first is None else _value(first, names)
        end = highest if first is None else begin if last is None else _value(last, names)
        stepped = int(step) if step is not None else 1
        if not lowest <= begin <= end <= highest or stepped == 0 or (first is not None and step and last is None):
            raise ValueError(part)
        found.update(range(begin, end + 1, stepped))
    return found


def _value(text: str, names: Mapping[str, int] | None) -> int:
    if text.isdigit():
        return int(text)
    if names is None or text not in names:
        raise ValueError(text)
    return names[text]


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
        raise InvalidError("server.timezone_unknown", timezone=timezone)
    try:
        Cron.parse(cron)
    except ValueError:
        raise InvalidError("server.cron_cannot_read", cron=cron) from None
    following = upcoming(cron, timezone, now)
    first = next(following, None)
    if first is None:
        raise InvalidError("server.cron_never_comes", cron=cron)
    for _ in range(12):
        second = next(following, None)
        if second is None:
            return
        if second - first < SHORTEST:
            least = SHORTEST.seconds // 60
            raise InvalidError("server.cron_comes_more_often", cron=cron, least=least)
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
