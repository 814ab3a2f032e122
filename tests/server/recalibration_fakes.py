"""Services with schedules whose clock a test sets, and calibrations that only note what is asked."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from service_fakes import MACHINE, Fakes, Running, running_service

from server.alarms.alarm_desk import Alarms
from server.jobs.job_runner import JobRunner
from server.machines.machine_desk import MachineDesk
from server.recalibrations.recalibration_resource import COMPARISON, POLICY
from server.recalibrations.recalibration_site import Site
from server.recalibrations.recalibration_store import Plan
from server.schedules.schedule_clock import ScheduleClock
from server.schedules.schedule_store import Schedule, Schedules, SlotResource

PLAN = Plan(duration_s=12.0, deadline_s=600.0)
GREW = {"joints": {"joint1": {"before": 2.0, "after": 1.0}}, "change_percent": -50.0, "better": True, "worse": []}


@dataclass(frozen=True)
class FakeCalibration:
    id: str
    source: str


class FakeCalibrations:
    """Calibrations that remember what was done with them."""

    def __init__(self) -> None:
        self.now: FakeCalibration | None = None
        self.proposed: dict[str, FakeCalibration] = {}
        self.activated: list[tuple[str, str]] = []
        self.ordered_by: list[tuple[str, str] | None] = []

    def active(self, machine: str, of: str = "identification") -> FakeCalibration | None:
        return self.now if of == "identification" else None

    def propose(self, identification: str, label: str, by: tuple[str, str] | None) -> FakeCalibration:
        self.ordered_by.append(by)
        made = FakeCalibration(f"cal-{len(self.proposed) + 1}", identification)
        return self.proposed.setdefault(identification, made)

    def activate(self, id: str, note: str) -> None:
        self.activated.append((id, note))


class Setting:
    """A service with a clock that a test sets."""

    def __init__(self, running: Running, calibrations: FakeCalibrations) -> None:
        self.running = running
        self.service = running.service
        self.calibrations = calibrations
        self.time = datetime(2026, 6, 1, 12, tzinfo=UTC)
        self.clock = ScheduleClock(
            self.service[Schedules]._database,
            self.service[JobRunner].enqueue,
            self.service[Site].ready,
            lambda: self.time,
        )

    def schedule(self, cron: str = "0 * * * *", plan: Plan = PLAN) -> Schedule:
        made = Schedule(
            id=f"sch-{len(self.service[Schedules].list(500).items)}",
            machine="lever",
            label="Nightly",
            cron=cron,
            timezone="UTC",
            enabled=True,
            plan=plan,
            considered=self.time.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            created="2026-01-01T00:00:00.000Z",
        )
        self.service[Schedules].keep(made)
        return made

    def later(self, hours: float) -> tuple[str, ...]:
        self.time += timedelta(hours=hours)
        return self.clock.look()

    def slots(self, schedule: Schedule) -> tuple[SlotResource, ...]:
        return self.service[Schedules].slots(schedule.id, 50)

    def alarms(self) -> dict[str, str]:
        return {alarm.kind: alarm.text for alarm in self.service[Alarms].active() if alarm.machine == "lever"}


@contextmanager
def setting(data_dir: Path, **settings: Any) -> Iterator[Setting]:
    fakes, calibrations = Fakes(), FakeCalibrations()
    script = Path(__file__).with_name("fake_comparison.py")
    fakes.parts |= {COMPARISON: (sys.executable, str(script)), POLICY: calibrations}
    with running_service(data_dir, fakes, **settings) as running:
        running.service[ScheduleClock].rounds.stop()  # the test's own clock is the only one
        running.service[MachineDesk].upload(MACHINE.encode())
        running.service[MachineDesk].set_acquisition("lever", True)
        assert fakes.acquisition.up.wait(30)
        yield Setting(running, calibrations)
