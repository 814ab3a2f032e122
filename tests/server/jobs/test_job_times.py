"""When a job will end, as earlier jobs of its kind tell; times are set by hand, so that the answer is known."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from server.composition.declarations import TABLES
from server.jobs.job_resource import expected_end
from server.jobs.job_store import Jobs
from server.platform.database.engine import Database, as_stored

STAGES = ("check", "fit", "report")
START = datetime(2026, 3, 1, 12, tzinfo=UTC)


class Bench:
    """Jobs that take as long as a test says."""

    def __init__(self, place: Path) -> None:
        self.now = START
        self.database = Database(place, TABLES, changed=lambda: None, clock=lambda: self.now)
        self.jobs = Jobs(self.database)
        self._count = 0

    def order(self, kind: str = "identification", stages: tuple[str, ...] = STAGES) -> str:
        self._count += 1
        id = f"job-{self._count}"
        with self.database.write("jobs") as connection:
            self.jobs.insert(connection, id=id, kind=kind, label="", subject=id, stages=stages)
        return id

    def past(self, *seconds: float, kind: str = "identification", stages: tuple[str, ...] = STAGES) -> None:
        """A job that was done, with the seconds of each of its stages."""
        id = self.order(kind, stages)
        for number, (stage, took) in enumerate(zip(stages, seconds, strict=True)):
            self.jobs.progress(id, stage, number / len(stages), "")
            self.wait(took)
        self.jobs.finish(id, "done", "Done")

    def wait(self, seconds: float) -> None:
        self.now += timedelta(seconds=seconds)

    def remaining(self, id: str) -> float | None:
        end = expected_end(self.database, self.jobs.get(id))
        return None if end is None else (datetime.fromisoformat(end) - self.now).total_seconds()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "store.sqlite")
    yield bench
    bench.database.close()


def test_stages_take_what_they_took_in_the_median(bench: Bench) -> None:
    for fit in (10, 30, 200):  # median 30
        bench.past(4, fit, 6)
    job = bench.order()
    assert bench.remaining(job) is None, "it waits for others, for how long nobody knows"
    bench.jobs.progress(job, "check", 0.0, "")
    assert bench.remaining(job) == pytest.approx(4 + 30 + 6)
    bench.wait(3)
    bench.jobs.progress(job, "fit", 0.33, "")
    assert bench.remaining(job) == pytest.approx(30 + 6)
    bench.wait(20)
    assert bench.remaining(job) == pytest.approx(10 + 6)
    bench.wait(500)
    assert bench.remaining(job) == pytest.approx(6), "what takes longer than usual is about to end"
    bench.jobs.finish(job, "done", "Done")
    assert bench.remaining(job) is None


def test_a_job_that_failed_and_one_of_another_kind_tell_nothing(bench: Bench) -> None:
    bench.past(1, kind="excitation", stages=("design",))
    failed = bench.order()
    bench.jobs.progress(failed, "check", 0.0, "")
    bench.wait(1)
    bench.jobs.finish(failed, "failed", "Failed", "no")
    job = bench.order()
    bench.jobs.progress(job, "check", 0.05, "")
    bench.wait(10)
    assert bench.remaining(job) is None


def test_without_an_earlier_one_its_own_progress_is_carried_on(bench: Bench) -> None:
    job = bench.order()
    bench.jobs.progress(job, "check", 0.0, "")
    bench.wait(20)
    bench.jobs.progress(job, "fit", 0.25, "")
    assert bench.remaining(job) == pytest.approx(60)


def test_what_is_expected_is_a_time_as_the_store_writes_it(bench: Bench) -> None:
    bench.past(1, 1, 1)
    job = bench.order()
    bench.jobs.progress(job, "check", 0.0, "")
    assert expected_end(bench.database, bench.jobs.get(job)) == as_stored(bench.now + timedelta(seconds=3))
