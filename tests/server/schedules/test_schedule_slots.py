"""When slots are: cron in a time zone, days with 23 and 25 hours, expressions that make no sense."""

from __future__ import annotations

from contextlib import suppress
from datetime import UTC, date, datetime, timedelta
from itertools import islice, pairwise
from zoneinfo import ZoneInfo

import pytest
from croniter import CroniterBadDateError, croniter
from hypothesis import example, given, settings
from hypothesis import strategies as st

from server.platform.errors import InvalidError
from server.schedules.schedule_slots import Cron, check, due, upcoming

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
        *(
            (f"{minute} {hour} {rest}", "UTC", "cannot be read")
            for minute, hour, rest in (
                ("R", "R", "* * *"),
                ("R(0-10)", "2", "* * *"),
                ("H", "2", "* * *"),
                ("0", "2", "L * *"),
                ("0", "2", "* * MON#1"),
                ("0", "2", "1W * *"),
                ("0", "2", "* * 5L"),
                ("0", "2", "? * *"),
                ("5/10", "*", "* * *"),
                ("*/0", "*", "* * *"),
                ("0", "17-8", "* * *"),
                ("0", "2", "* JAN-DEZ *"),
                ("0,", "2", "* * *"),
                ("0", "2", "* * 8"),
                ("MON", "2", "* * *"),
                ("-1", "2", "* * *"),
                ("٣", "2", "* * *"),
            )
        ),
        ("0 0 30 2 *", "UTC", "never comes"),
        ("* * * * *", "UTC", "more often"),
        ("0 2 * * *", "Mars/Olympus", "unknown"),
        ("0 2 * * *", "../etc/passwd", "unknown"),
    ],
)
def test_what_makes_no_sense_is_refused(cron: str, zone: str, says: str) -> None:
    with pytest.raises(InvalidError, match=says):
        check(cron, zone, at("2026-01-01T00:00"))


def fields(low: int, high: int) -> st.SearchStrategy[str]:
    """A field as crontab(5) has it."""
    ranges = st.tuples(st.integers(low, high), st.integers(low, high)).filter(lambda e: e[0] < e[1])  # 0-0: all, there
    steps = st.integers(1, high)
    part = st.one_of(
        st.integers(low, high).map(str),
        ranges.map(lambda ends: f"{ends[0]}-{ends[1]}"),
        st.tuples(ranges, steps).map(lambda own: f"{own[0][0]}-{own[0][1]}/{own[1]}"),
        steps.map(lambda step: f"*/{step}"),
    )
    # A star comes first (* sorts before digits): after something else croniter takes it as no crontab(5) does.
    return st.one_of(st.just("*"), st.lists(part, min_size=1, max_size=3).map(lambda parts: ",".join(sorted(parts))))


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(
    expression=st.tuples(fields(0, 59), fields(0, 23), fields(1, 31), fields(1, 12), fields(0, 6)).map(" ".join),
    start=st.datetimes(datetime(2024, 1, 1), datetime(2030, 1, 1)),
)
@example("0 0 */2 * 1", datetime(2024, 1, 2))
@example("0 0 2 * */1", datetime(2024, 1, 2))
@example("0 0 2 * 1", datetime(2024, 1, 2))
def test_an_expression_means_what_it_means_elsewhere(expression: str, start: datetime) -> None:
    """Against croniter, which reads the same five fields, and more; a star in a day's field is what cron has it be."""
    theirs = croniter(expression, start, ret_type=datetime, max_years_between_matches=50, implement_cron_bug=True)
    expected = []
    with suppress(CroniterBadDateError):
        expected = [theirs.get_next() for _ in range(8)]
    assert list(islice(Cron.parse(expression).after(start), len(expected))) == expected
    if not expected:
        assert next(Cron.parse(expression).after(start), None) is None


@pytest.mark.parametrize(
    ("days", "either"),
    [
        ("2 * 1", True),
        ("*/2 * 1", False),
        ("2 * */2", False),
        ("*/2,5 * 1", False),
        ("5,*/2 * 1", True),
        ("* * 1", False),
    ],
)
def test_a_days_field_that_begins_with_a_star_restricts_nothing(days: str, either: bool) -> None:
    """As in cron, which looks at the first character."""
    assert Cron.parse(f"0 0 {days}").either_day is either


def test_names_and_sunday_twice() -> None:
    assert Cron.parse("0 2 * jan,Mar-MAY mon-FRI") == Cron.parse("0 2 * 1,3,4,5 1-5")
    assert Cron.parse("0 2 * * 7") == Cron.parse("0 2 * * SUN") == Cron.parse("0 2 * * 0")
    assert Cron.parse("0 2 * * 5-7").weekdays == {5, 6, 0}


def test_a_schedule_that_was_taken_before_there_was_a_grammar_comes_no_more() -> None:
    assert list(upcoming("R R * * *", "UTC", at("2026-01-01T00:00"))) == []


@pytest.mark.parametrize("cron", ["*/5 * * * *", "30 2 * * 1", "0 0 29 2 *"])
def test_what_makes_sense_is_taken(cron: str) -> None:
    check(cron, VIENNA, at("2026-01-01T00:00"))
