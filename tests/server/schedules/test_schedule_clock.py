"""The clock of schedules, on a store alone."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from server.composition.declarations import RESOURCES
from server.machines.machine_store import Machines
from server.platform.database.engine import Database, as_stored
from server.platform.resource import tables_of
from server.recalibrations.recalibration_store import Plan
from server.schedules import schedule_slots
from server.schedules.schedule_clock import ScheduleClock
from server.schedules.schedule_store import Schedule, Schedules

NOW = datetime(2026, 6, 1, 12, 1, tzinfo=UTC)


def test_a_machine_that_is_being_recalibrated_costs_its_schedules_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database = Database(tmp_path / "store.sqlite", tables_of(RESOURCES), changed=lambda: None)
    Machines(database).add("lever", 1, "hash")
    # Slots of a year wait: to count them takes long, and the clock looks every two seconds.
    schedule = Schedule(
        id="sch-1",
        machine="lever",
        label="",
        cron="*/5 * * * *",
        timezone="UTC",
        enabled=True,
        plan=Plan(),
        considered=as_stored(NOW - timedelta(days=1)),
        created="",
    )
    Schedules(database).keep(schedule)
    ordered: list[str] = []
    clock = ScheduleClock(database, ordered.append, lambda machine: None, lambda: NOW)
    assert clock.look() == tuple(ordered) and len(ordered) == 1
    looked: list[str] = []
    monkeypatch.setattr(schedule_slots, "due", lambda cron, *_: looked.append(cron))
    assert clock.look() == ()
    assert looked == []
    database.close()
