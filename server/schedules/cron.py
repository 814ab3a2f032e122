"""Cron expressions of five fields: minute, hour, day of the month, month, day of the week.

==========================  =============================================================================
a field is a list of        that means
==========================  =============================================================================
``*``                       every value
``7``, ``JUL``, ``MON``     one; names for months and days of the week only; Sunday is 0 or 7
``8-17``                    a range, both ends in it
``*/15``, ``8-18/2``        every fifteenth from the first, every second of a range
``1,15,28-31``              any of several
==========================  =============================================================================

Where both day fields are given (neither is ``*``), a day that fits either counts, as in crontab(5). There is nothing
else: no seconds, no ``@daily``, nothing random, no last day, no n-th Monday.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from itertools import product

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
    """What an expression means; ``either_day``: a day of the month or of the week is enough."""

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
            either_day="*" not in (day, weekday),
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
