"""What a schedule would do, told before there is one."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from zoneinfo import ZoneInfo

import pytest
from service_fakes import API, Running

UPCOMING = f"{API}/schedules/upcoming"


def test_the_next_five_slots_are_told_in_utc(running: Running) -> None:
    answer = running.client.get(UPCOMING, params={"cron": "30 2 * * *", "timezone": "Europe/Vienna"})
    assert answer.status_code == 200
    slots = [datetime.fromisoformat(slot) for slot in answer.json()["slots"]]
    assert len(slots) == 5
    assert all(slot.tzinfo == UTC or slot.utcoffset() == UTC.utcoffset(None) for slot in slots)
    local = [slot.astimezone(ZoneInfo("Europe/Vienna")) for slot in slots]
    # On the day on which the clock is put forward 02:30 does not exist: it is 03:30 then.
    assert all((one.hour, one.minute) in ((2, 30), (3, 30)) for one in local)
    assert all((b.date() - a.date()).days == 1 for a, b in pairwise(local))


@pytest.mark.parametrize(
    ("cron", "zone", "says"),
    [
        ("* * * * *", "UTC", "more often"),
        ("30 2 31 2 *", "UTC", "never comes"),
        ("often", "UTC", "cannot be read"),
        ("30 2 * * *", "Mars/Olympus", "unknown"),
    ],
)
def test_what_could_be_no_schedule_is_refused_in_the_same_words(
    running: Running, cron: str, zone: str, says: str
) -> None:
    answer = running.client.get(UPCOMING, params={"cron": cron, "timezone": zone})
    assert answer.status_code == 422
    assert says in answer.json()["detail"]
