"""When slots are: cron in a time zone, days with 23 and 25 hours, expressions that make no sense."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta
from itertools import islice, pairwise
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.platform.errors import InvalidError
from server.schedules.schedule_slots import check, due, upcoming

VIENNA = "Europe/Vienna"


def at(text: str) -> datetime:
    return datetime.fromisoformat(text).replace(tzinfo=UTC)


def first(cron: str, zone: str, after: str, count: int) -> list[str]:
    return [f"{slot:%Y-%m-%dT%H:%M}" for slot in islice(upcoming(cron, zone, at(after)), count)]


def test_a_time_that_comes_twice_counts_once() -> None:
    # On 2026-10-25 the clock in Vienna goes from 03:00 CEST back to 02:00 CET.
    assert first("30 2 * * *", VIENNA, "2026-10-24T12:00", 2) == ["2026-10-25T00:30", "2026-10-26T01:30"]
    # Between the two occurrences the slot is over.
    assert first("30 2 * * *", VIENNA, "2026-10-25T00:30", 1) == ["2026-10-26T01:30"]


def test_a_time_that_does_not_exist_counts_as_late_as_the_clock_jumped() -> None:
    # On 2026-03-29 the clock in Vienna goes from 02:00 CET to 03:00 CEST: 02:30 becomes 03:30 CEST.
    assert first("30 2 * * *", VIENNA, "2026-03-28T12:00", 2) == ["2026-03-29T01:30", "2026-03-30T00:30"]


def test_two_wall_clock_times_that_are_one_moment_are_one_slot() -> None:
    # 02:15 does not exist and becomes 03:15, which is a slot of its own as well.
    assert first("15 2,3 * * *", VIENNA, "2026-03-28T12:00", 3) == [
        "2026-03-29T01:15",
        "2026-03-30T00:15",
        "2026-03-30T01:15",
    ]


def test_the_local_hour_is_the_same_all_year() -> None:
    slots = list(islice(upcoming("0 6 * * *", VIENNA, at("2026-01-01T00:00")), 365))
    assert {slot.astimezone(ZoneInfo(VIENNA)).hour for slot in slots} == {6}
    assert {(b - a) for a, b in pairwise(slots)} == {timedelta(hours=hours) for hours in (23, 24, 25)}


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    start=st.datetimes(datetime(2024, 1, 1), datetime(2030, 1, 1)),
    zone=st.sampled_from([VIENNA, "America/New_York", "Australia/Lord_Howe", "Asia/Kathmandu", "UTC"]),
    hour=st.integers(0, 23),
    minute=st.integers(0, 59),
)
def test_a_daily_schedule_has_one_slot_for_every_day_of_the_calendar(
    start: datetime, zone: str, hour: int, minute: int
) -> None:
    slots = list(islice(upcoming(f"{minute} {hour} * * *", zone, start.replace(tzinfo=UTC)), 400))
    days = [slot.astimezone(ZoneInfo(zone)).date() for slot in slots]
    assert days == [date.fromordinal(days[0].toordinal() + n) for n in range(400)]
    assert slots[0] > start.replace(tzinfo=UTC)


@pytest.mark.slow
def test_what_is_due_is_later_than_before_and_not_later_than_now() -> None:
    found = due("0 * * * *", "UTC", at("2026-01-01T00:00"), at("2026-01-01T03:00"), 50)
    assert [slot.hour for slot in found] == [1, 2, 3]
    assert due("0 * * * *", "UTC", at("2026-01-01T03:00"), at("2026-01-01T03:59"), 50) == ()
    newest = due("0 * * * *", "UTC", at("2025-01-01T00:00"), at("2026-01-01T03:00"), 2)
    assert [slot.hour for slot in newest] == [2, 3]


def test_a_clock_that_was_put_back_gives_no_slot_again() -> None:
    assert due("0 * * * *", "UTC", at("2026-01-01T03:00"), at("2026-01-01T01:30"), 50) == ()


@pytest.mark.parametrize(
    ("cron", "zone", "says"),
    [
        ("61 * * * *", "UTC", "cannot be read"),
        ("* * * *", "UTC", "minute hour day"),
        ("0 0 2 * * *", "UTC", "minute hour day"),
        ("@daily", "UTC", "minute hour day"),
        ("0 0 30 2 *", "UTC", "never comes"),
        ("* * * * *", "UTC", "more often"),
        ("0 2 * * *", "Mars/Olympus", "unknown"),
        ("0 2 * * *", "../etc/passwd", "unknown"),
    ],
)
def test_what_makes_no_sense_is_refused(cron: str, zone: str, says: str) -> None:
    with pytest.raises(InvalidError, match=says):
        check(cron, zone, at("2026-01-01T00:00"))


@pytest.mark.parametrize("cron", ["*/5 * * * *", "30 2 * * 1", "0 0 29 2 *"])
def test_what_makes_sense_is_taken(cron: str) -> None:
    check(cron, VIENNA, at("2026-01-01T00:00"))
