"""Recalibrations by the clock: slots once, missed ones together, one at a time per machine."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from recalibration_fakes import GREW, PLAN, FakeCalibration, Setting, setting
from service_fakes import API, ran

from server.identifications.identification_store import Identifications
from server.jobs.job_store import Jobs
from server.machines.machine_desk import MachineDesk
from server.recalibrations.recalibration_site import Site
from server.recalibrations.recalibration_store import Recalibrations
from server.recordings.recording_sessions import Sessions
from server.recordings.recording_store import Recordings
from server.schedules.schedule_store import Schedules, SlotResource

pytestmark = pytest.mark.slow


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Setting]:
    with setting(tmp_path) as made:
        yield made


def test_each_scheduled_time_runs_once_and_proposes_a_calibration(site: Setting) -> None:
    schedule = site.schedule()
    assert site.later(0.5) == ()
    (job,) = site.later(0.6)
    assert site.later(0) == (), "the same moment again"
    events = site.running.follow(job)
    assert events[-1]["state"] == "done", site.service[Jobs].get(job)
    assert {event["stage"] for event in events[1:]} == {"record", "identify", "compare", "propose"}
    assert "Recording" in [event["text"] for event in events]
    assert site.slots(schedule) == (
        SlotResource(slot="2026-06-01T13:00:00.000Z", job=job, state="done", note="", calibration="cal-1"),
    )
    made = Recalibrations(site.service[Schedules]._database).get(site.service[Jobs].get(job).subject)
    assert list(made.recordings) == ["operation", "validate"]
    assert made.comparison is None
    assert site.calibrations.proposed.keys() == {made.identification}
    assert site.calibrations.activated == []
    assert made.identification is not None
    assert ran(site.running, made.identification) == ["check", "cylinder_stage", "report"]
    # An hour later comes the next one.
    (second,) = site.later(1)
    assert site.running.follow(second)[-1]["state"] == "done"


def test_missed_slots_have_their_turn_together(site: Setting) -> None:
    schedule = site.schedule()
    (job,) = site.later(5.5)
    found = site.slots(schedule)
    assert [slot.state for slot in found[1:]] == ["coalesced"] * 4
    assert (found[0].slot, found[0].job, found[0].note) == ("2026-06-01T17:00:00.000Z", job, "stands for 4 earlier")
    assert site.later(0.1) == ()
    site.running.follow(job)


def test_recalibrations_of_one_machine_run_one_after_another(site: Setting) -> None:
    (site.service.files.root / "steer.json").write_text('{"block": "check"}')
    schedule, other = site.schedule(), site.schedule("30 * * * *")
    (job,) = site.later(1)
    assert site.later(2) == (), "the machine is being recalibrated"
    site.service[Jobs].request_cancel(job)
    assert site.running.follow(job)[-1]["state"] == "cancelled"
    assert site.slots(schedule)[0].state == "failed"
    (site.service.files.root / "steer.json").unlink()
    (following,) = site.later(0)
    assert site.running.follow(following)[-1]["state"] == "done"
    assert [slot.state for slot in site.slots(schedule)] == ["done", "coalesced", "failed"]
    (last,) = site.later(0)
    assert site.running.follow(last)[-1]["state"] == "done"
    assert [slot.state for slot in site.slots(other)] == ["done", "coalesced", "coalesced"]


def test_a_slot_of_a_machine_that_is_not_acquired_is_missed_and_says_why(site: Setting) -> None:
    schedule = site.schedule()
    site.service[MachineDesk].set_acquisition("lever", False)
    assert site.later(1) == ()
    (slot,) = site.slots(schedule)
    assert (slot.state, slot.job) == ("missed", None)
    assert "not being acquired" in slot.note


def test_two_servers_order_one_recalibration_per_slot(site: Setting) -> None:
    schedule = site.schedule()
    seen = site.service[Schedules].get(schedule.id)
    (job,) = site.later(1)
    # What the other one would do with what it read before.
    new = site.service[Recalibrations].get(site.service[Jobs].get(job).subject).but(id="other")
    site.running.follow(job)
    slots = ["2026-06-01T13:00:00.000Z"]
    assert not site.service[Schedules].claim(seen, slots, new.but(job="job-other"), ("", ""))
    assert len(site.slots(schedule)) == 1


@pytest.mark.parametrize(
    ("policy", "better", "activated"), [("if_better", True, 1), ("if_better", False, 0), ("never", True, 0)]
)
def test_only_the_policy_activates_and_only_what_is_better(
    site: Setting, policy: Any, better: bool, activated: int
) -> None:
    site.calibrations.now = FakeCalibration("cal-0", identified(site))
    content = {**GREW, "better": better, "grew": ["joint1"]}
    (site.service.files.root / "comparison.json").write_text(json.dumps(content))
    site.schedule(plan=replace(PLAN, activate=policy))
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "done", site.service[Jobs].get(job)
    made = Recalibrations(site.service[Schedules]._database).get(site.service[Jobs].get(job).subject)
    assert made.comparison == {**content, "active": "cal-0"}
    assert len(site.calibrations.activated) == activated
    assert "joint1" in site.alarms()["residual_grew"]


def test_a_person_who_orders_one_is_who_proposes_and_a_slot_is_nobody(site: Setting) -> None:
    schedule = site.schedule()
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "done"
    ordered = site.running.client.post(f"{API}/schedules/{schedule.id}/run").json()["id"]
    assert site.running.follow(ordered)[-1]["state"] == "done"
    me = site.running.client.get(f"{API}/access/me").json()
    assert site.calibrations.ordered_by == [None, (me["id"], me["name"])]


def identified(site: Setting) -> str:
    """An identification that is done, for a calibration that is active."""
    site.schedule()
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "done"
    schedule = site.service[Schedules].list(1).items[0]
    site.service[Schedules].delete(schedule.id, None)
    return next(iter(site.calibrations.proposed))


def test_a_recalibration_that_fails_raises_an_alarm_and_the_next_good_one_clears_it(site: Setting) -> None:
    site.running.fakes.recorder.fail = "the bus went away"
    schedule = site.schedule()
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "failed"
    assert "the bus went away" in str(site.service[Jobs].get(job).error)
    assert site.slots(schedule)[0].state == "failed"
    assert "the bus went away" in site.alarms()["recalibration_failed"]
    site.running.fakes.recorder.fail = None
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "done"
    assert "recalibration_failed" not in site.alarms()


def test_a_recalibration_goes_on_after_a_restart_without_recording_again(tmp_path: Path) -> None:
    with setting(tmp_path) as site:
        (site.service.files.root / "steer.json").write_text('{"block": "check"}')
        schedule = site.schedule()
        (job,) = site.later(1)
        site.running.follow(job, lambda event: event["text"] == "Half of check")
        recorded = [row.id for row in site.service[Recordings].list(10).items]
    (tmp_path / "steer.json").unlink()
    with setting(tmp_path) as again:
        assert again.running.follow(job)[-1]["state"] == "done"
        assert [row.id for row in again.service[Recordings].list(10).items] == recorded
        assert [slot.state for slot in again.slots(schedule)] == ["done"]
        assert len(again.service[Identifications].list(10).items) == 1


def test_the_standard_motion_of_a_real_machine_waits_for_a_person_and_says_what_to_do(site: Setting) -> None:
    site.schedule(plan=replace(PLAN, motion="standard", excitations=("exc-1",)))
    site.service[Site].motion_seconds = lambda excitation: 11.0  # type: ignore[method-assign]
    (job,) = site.later(1)
    events = site.running.follow(job, lambda event: event["text"].startswith("Waiting for a person"))
    assert "load the motion of exc-1" in events[-1]["text"]
    assert "'train' and 'validate'" in events[-1]["text"]
    for role in ("train", "validate"):
        started = site.service[Sessions].start("lever", role, "", 10.0)
        while site.service[Recordings].get(started.id).state == "recording":
            asyncio.run(site.service.changes.wait(site.service.changes.number, 1.0))
    assert site.running.follow(job)[-1]["state"] == "done", site.service[Jobs].get(job)


def test_a_recalibration_without_its_standard_motion_fails_at_the_deadline(site: Setting) -> None:
    site.service[Site].motion_seconds = lambda excitation: 11.0  # type: ignore[method-assign]
    site.schedule(plan=replace(PLAN, motion="standard", excitations=("exc-1",), deadline_s=0.0))
    (job,) = site.later(1)
    assert site.running.follow(job)[-1]["state"] == "failed"
    assert "nobody recorded the standard motion" in str(site.service[Jobs].get(job).error)
