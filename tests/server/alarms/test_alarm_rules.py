"""Alarms as rules: delays, dead-band, and what may follow what; time is given, nothing is stored."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.alarms import alarm_lifecycle as lifecycle
from server.alarms.alarm_lifecycle import KINDS, Alarm, AlarmKind, DeadBand, Timer, beyond, step

NEW = Alarm(
    id="a1",
    machine="lever",
    kind="channel_stale",
    text="no measurement",
    severity="warning",
    raised="2026-01-01T00:00:00.000Z",
)
NOW = datetime(2026, 1, 1, 12, tzinfo=UTC)


@pytest.mark.parametrize("kind", KINDS.values(), ids=list(KINDS))
def test_delays_are_no_secret_and_not_negative(kind: AlarmKind) -> None:
    assert kind.on_delay_s >= 0 <= kind.off_delay_s


@given(
    on=st.floats(0, 10),
    off=st.floats(0, 10),
    looks=st.lists(st.tuples(st.floats(0.01, 3), st.booleans()), min_size=1, max_size=60),
)
def test_the_timer_changes_when_the_condition_has_held_for_the_delay(
    on: float, off: float, looks: list[tuple[float, bool]]
) -> None:
    """Against a search through the whole history of looks."""
    kind, timer, now = AlarmKind(on, off), Timer(), 0.0
    history: list[tuple[float, bool]] = []
    state = False
    for pause, condition in looks:
        now += pause
        history.append((now, condition))
        timer = step(timer, kind, condition, now)
        began = now
        for time, held in reversed(history):
            if held == state:
                break
            began = time
        if condition != state and now - began >= (off if state else on):
            state = condition
            history.clear()
        assert timer.on == state


def test_flicker_shorter_than_the_delay_is_nothing() -> None:
    kind, timer = AlarmKind(on_delay_s=3), Timer()
    for second in range(100):
        timer = step(timer, kind, second % 3 != 0, float(second))
        assert not timer.on


@given(st.lists(st.floats(-10, 30), max_size=50), st.booleans())
def test_within_the_dead_band_nothing_changes_and_beyond_it_what_was_does_not_matter(
    values: list[float], was: bool
) -> None:
    rising, falling = DeadBand(comes=10, goes=8), DeadBand(comes=8, goes=10)
    for value in values:
        inside = 8 < value < 10
        assert beyond(value, rising, was) is (was if inside else value >= 10)
        assert beyond(value, falling, was) is (was if inside else value <= 8)
    assert beyond(float("nan"), rising, was) is was


def test_noise_about_a_limit_is_one_alarm() -> None:
    limits, on, times = DeadBand(comes=10, goes=8), False, 0
    for k in range(200):
        before, on = on, beyond(10 + 0.5 * (-1) ** k, limits, on)
        times += on and not before
    assert times == 1


def test_an_unacknowledged_alarm_that_returns_is_counted() -> None:
    gone = lifecycle.clear(NEW, "2026-01-01T00:01:00.000Z")
    again = NEW.but(id="a2", raised="2026-01-01T00:02:00.000Z", text="another")
    back = lifecycle.raise_(gone, again)
    assert (back.id, back.count, back.raised, back.text, back.state) == ("a1", 2, again.raised, "another", "active")


def test_an_acknowledged_alarm_that_returns_is_new_and_stays_shelved() -> None:
    seen = lifecycle.acknowledge(NEW, "Ada")
    assert lifecycle.acknowledge(seen, "Bob").acknowledged_by == "Ada"
    gone = lifecycle.clear(lifecycle.shelve(seen, "Ada", "known", 60, NOW), "2026-01-01T00:01:00.000Z")
    new = lifecycle.raise_(gone, NEW.but(id="a2"))
    assert (new.id, new.count, new.acknowledged, new.shelved_until) == ("a2", 1, False, "2026-01-01T12:01:00.000Z")


def test_while_active_only_its_text_and_severity_move() -> None:
    worse = lifecycle.raise_(NEW, NEW.but(id="a2", raised="later", text="worse", severity="critical"))
    assert worse == NEW.but(text="worse", severity="critical")


def test_clearing_twice_keeps_the_first_time() -> None:
    once = lifecycle.clear(NEW, "t1")
    assert lifecycle.clear(once, "t2") == once


@pytest.mark.parametrize(
    ("later_s", "over"),
    [(0, False), (59, False), (60, True), (1e7, True), (-3600, False), (-86400, True)],
    ids=["at once", "before", "on time", "clock set on", "clock set back a little", "clock set back a day"],
)
def test_a_shelf_ends_by_itself_and_no_clock_makes_it_last(later_s: float, over: bool) -> None:
    shelved = lifecycle.shelve(NEW, "Ada", "known", 60, NOW)
    assert lifecycle.expired(shelved, NOW + timedelta(seconds=later_s)) is over
    assert not lifecycle.expired(lifecycle.unshelve(shelved), NOW)


def test_an_alarm_cannot_be_shelved_longer_than_allowed() -> None:
    shelved = lifecycle.shelve(NEW, "Ada", "holiday", 1e9, NOW)
    assert shelved.shelved_until == "2026-01-02T12:00:00.000Z"
