"""Checks of what has to be so after a storm, read from the database, the files and the engine, not from the service."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections import Counter
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow.parquet
import sqlalchemy as sa

from benchmarks.pages import filled
from benchmarks.service.postgresql import OWNER
from benchmarks.storm.stages import STAGES
from benchmarks.storm.traffic import CANCELLED_IN, Acknowledged
from benchmarks.targets import Check, fact
from server.audit.audit_resource import Audit
from server.identifications import identification_store
from server.identifications.identification_results import IdentificationResults
from server.identifications.identification_store import Identifications
from server.jobs import job_store
from server.jobs.execution import KEEP_S
from server.jobs.job_store import FINAL
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.recalibrations import recalibration_store
from server.recalibrations.recalibration_recording import TRIES
from server.recordings import recording_store
from server.schedules import schedule_store
from server.schedules.schedule_clock import KEPT

#: Counts every time that a result is stored, by a trigger that is none of the service's.
COUNTED = "storm_results"
#: When a finished step was recorded, ms of UNIX time: by the database's clock, which the storm does not set.
STEPS = "storm_steps"
#: Recalibrations that were ordered while another one was not over.
TOGETHER = "storm_together"
#: Seconds after the acknowledgement of a cancel within which a stage may begin: one was being started.
STARTING_S = 5.0


def count_results(database: Database) -> None:
    """Put the triggers there, before the storm."""
    names = {"counted": COUNTED, "together": TOGETHER, "steps": STEPS}
    statements = filled("storm/triggers.sql.j2", sqlite=database.is_sqlite, **names).split("\n\n")
    with database.write() as connection:
        for statement in filter(str.strip, statements):
            connection.exec_driver_sql(statement)


def _counted(database: Database, name: str) -> list[str]:
    with database.read() as connection:
        return [str(found) for found in connection.execute(sa.text(f"SELECT subject FROM {name}")).scalars()]


def _rows(database: Database, query: sa.Select[Any]) -> list[Any]:
    with database.read() as connection:
        return list(connection.execute(query).all())


def _none(name: str, what: list[str], of: int) -> Check:
    """Check that none of so many is wrong; name the first that are."""
    return fact(name, not what, f"{of}" if not what else f"{len(what)} of {of} wrong: {'; '.join(what[:5])}")


def all_checks(
    database: Database, files: DataDirectory, noted: Acknowledged, workers: Sequence[Path]
) -> Iterator[Check]:
    """Run every check; ``workers``: data directories of those that have their own."""
    hosts = (files.root, *workers)
    yield from _jobs(database, noted)
    yield from _cancels(database, hosts, noted)
    yield from _results(database, noted)
    yield from _steps(database, hosts)
    if noted.undisturbed:
        yield _undisturbed(database, files, noted)
    yield from _recordings(database, files, noted)
    yield from _schedules(database)
    yield from _integrity(database, noted)


def _jobs(database: Database, noted: Acknowledged) -> Iterator[Check]:
    """Check that every job ended, and once; its events are numbered without a hole."""
    rows = _rows(database, sa.select(job_store.jobs))
    table = job_store.job_events
    by_job: dict[str, list[Any]] = {row.id: [] for row in rows}
    for event in _rows(database, sa.select(table).order_by(table.c.job, table.c.number)):
        by_job[event.job].append(event)
    wrong = []
    for row in rows:
        numbers = [event.number for event in by_job[row.id]]
        ends = [event.state for event in by_job[row.id] if event.state in FINAL]
        if row.state not in FINAL or ends != [row.state] or by_job[row.id][-1].state != row.state:
            wrong.append(f"{row.kind} {row.id} is {row.state}, ended {len(ends)} times")
        elif numbers != list(range(1, len(numbers) + 1)):
            wrong.append(f"{row.id}: events {numbers}")
    yield _none("jobs that ended once", wrong, len(rows))
    states = Counter((row.kind, row.state) for row in rows)
    shown = ", ".join(f"{n} {kind} {state}" for (kind, state), n in sorted(states.items()))
    yield Check("jobs by end", len(rows), shown)
    # The storm's reasons: a stage or an acquisition that was killed several times over, and a cancel.
    reasons = ("SIGKILL", f"ended early, {TRIES} times over")
    expected = [row for row in rows if row.state == "done" or any(text in (row.error or "") for text in reasons)]
    expected += [row for row in rows if row.state == "cancelled" and row.id in noted.asked]
    odd = [f"{row.id} {row.state}: {row.error}" for row in rows if row not in expected]
    yield _none("jobs that failed for no reason of the storm", odd, len(rows))


def _cancels(database: Database, hosts: Sequence[Path], noted: Acknowledged) -> Iterator[Check]:
    """Check that cancelled work ended so, unless just ending; no stage of it began afterwards."""
    states = {row.id: row.state for row in _rows(database, sa.select(job_store.jobs.c.id, job_store.jobs.c.state))}
    wrong, late = [], 0
    for job, cancel in noted.cancels.items():
        began = [float(run[1]) / 1e3 - cancel.at for run in _runs(hosts, cancel.identification)]
        if any(seconds > STARTING_S for seconds in began):
            wrong.append(f"{job}: a stage began {max(began):.1f} s after its cancel in {cancel.where}")
        elif states[job] == "cancelled":
            continue
        elif cancel.where == STAGES[-1] or states[job] == "failed":
            late += 1
        else:
            wrong.append(f"{job}: cancelled in {cancel.where}, and {states[job]}")
    yield _none("cancelled jobs that went no further", wrong, len(noted.cancels))
    where = Counter(cancel.where for cancel in noted.cancels.values())
    shown = ", ".join(f"{where[place]} in {place}" for place in CANCELLED_IN if where[place])
    yield Check("cancels by place", len(noted.cancels), f"{shown}; {late} of them had just ended")


def _runs(hosts: Sequence[Path], identification: str) -> list[list[str]]:
    """List stage, beginning (ms of UNIX time) and process of every stage begun on any host."""
    paths = (host / "identifications" / identification / "runs.txt" for host in hosts)
    return [line.split() for path in paths if path.is_file() for line in path.read_text().splitlines()]


def _results(database: Database, noted: Acknowledged) -> Iterator[Check]:
    """Check that every acknowledged order made one identification, stored once."""
    rows = _rows(database, sa.select(identification_store.identifications, job_store.jobs.c.state).join(
        job_store.jobs, job_store.jobs.c.id == identification_store.identifications.c.job))  # fmt: skip
    labels = Counter(row.label for row in rows if row.label.startswith("storm-"))
    by_id = {row.id: row for row in rows}
    wrong = [key for key, id in noted.orders.items() if id not in by_id or by_id[id].label != key]
    wrong += [label for label, count in labels.items() if count != 1]
    yield _none("acknowledged orders that made one job", wrong, len(noted.orders))
    stored = Counter(_counted(database, COUNTED))
    wrong = []
    for row in rows:
        done = row.state == "done"
        if stored[row.id] != done or (row.verdict is not None) != done:
            wrong.append(f"{row.id} {row.state}, stored {stored[row.id]} times")
    yield _none("results stored once", wrong, sum(row.state == "done" for row in rows))


def _undisturbed(database: Database, files: DataDirectory, noted: Acknowledged) -> Check:
    """Check that every real identification was done, with verdict, numbers and report of one before the storm."""
    results, rows = IdentificationResults(database, files), Identifications(database)

    def found(id: str) -> dict[str, Any]:
        report: dict[str, Any] = json.loads((results.directory(id) / "report.json").read_bytes())
        row = rows.get(id)
        return comparable(report) | {"verdict": row.verdict, "overall_stored": row.overall}

    expected, wrong = found(noted.undisturbed), []
    for key in noted.real:
        try:
            report = found(noted.orders[key])
            different = [part for part in expected if report.get(part) != expected[part]]
            wrong += [f"{key}: {', '.join(different)} differ"] if different else []
        except (OSError, ValueError) as error:
            wrong.append(f"{key}: no report ({error})")
    shown = f"{len(noted.real)}, each {expected['verdict']}" if not wrong else "; ".join(wrong)
    return fact("real identifications as undisturbed", bool(noted.real) and not wrong, shown)


def comparable(report: dict[str, Any]) -> dict[str, Any]:
    """Strip a report of its time, and files of their folders: where they lie differs from host to host."""
    data = [part | {"file": Path(part["file"]).name} for part in report["data"]]
    return report | {"created": None, "data": data}


def _steps(database: Database, hosts: Sequence[Path]) -> Iterator[Check]:
    """Check that no stage began again after it was recorded as done, but for what another host had not got."""
    wrong, begun, recorded, again = [], 0, 0, 0
    done: dict[str, dict[str, int]] = {}
    for text in _counted(database, STEPS):
        job, stage, moment = text.split()
        done.setdefault(job, {})[stage] = int(moment)
    query = sa.select(identification_store.identifications.c.id, identification_store.identifications.c.job)
    for row in _rows(database, query):
        found = done.get(row.job, {})
        runs = [(stage, int(began), host) for host in hosts for stage, began, _ in _runs((host,), row.id)]
        begun += len(runs)
        recorded += len(found)
        at_stake = dict.fromkeys(hosts, 0)  # ms that each had done and not shared
        for stage, ended in found.items():
            before = [(began, host) for name, began, host in runs if name == stage and began <= ended]
            where = {host for name, began, host in runs if name == stage and began > ended}
            if not before:  # the end of a job is a step too
                continue
            first, by = max(before)
            if by in where:
                wrong.append(f"{row.id}: {stage} began again where it had been done")
            if where:
                at_stake[by] += ended - first
                again += 1
        wrong += [f"{row.id}: {ms} ms of finished work done again" for ms in at_stake.values() if ms > KEEP_S * 1e3]
    yield _none("finished steps done again where they need not be", wrong, recorded)
    yield Check("stages begun", begun, f"{begun}, for {recorded} finished steps, {again} of them again on another host")


def _recordings(database: Database, files: DataDirectory, noted: Acknowledged) -> Iterator[Check]:
    """Check that every row reported safe by the server is in a sealed file whose hash is in the store."""
    rows = {row.id: row for row in _rows(database, sa.select(recording_store.recordings))}
    wrong, safe = [], 0
    for id, acknowledged in noted.rows.items():
        row, path = rows.get(id), files.recordings / f"{id}.parquet"
        safe += acknowledged
        if row is None or row.state == "recording":
            wrong.append(f"{id} is {'gone' if row is None else row.state}")
        elif row.state == "sealed":
            kept = pyarrow.parquet.read_metadata(path).num_rows
            if kept < acknowledged:
                wrong.append(f"{id}: {kept} rows of {acknowledged}")
            elif row.statistics.get("rows") != kept:
                wrong.append(f"{id}: {kept} rows, the store says {row.statistics}")
        elif acknowledged:
            wrong.append(f"{id} {row.state}, {acknowledged} rows lost: {row.error}")
    yield _none("recordings with every acknowledged row", wrong, len(noted.rows))
    yield Check("acknowledged rows", safe, f"{safe} in {len(noted.rows)} recordings")
    sealed = [row for row in rows.values() if row.state == "sealed"]
    wrong = [row.id for row in sealed if _sha256(files.recordings / f"{row.id}.{row.format}") != row.sha256]
    # One that failed before a row of it was safe may leave the beginning of a journal.
    failed = {f"{row.id}.{row.format}.journal" for row in rows.values() if row.state == "failed"}
    wrong += [path.name for path in files.recordings.glob("*.journal") if path.name not in failed]
    yield _none("sealed recordings that are what the store says", wrong, len(sealed))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _schedules(database: Database) -> Iterator[Check]:
    """Check that every slot of ``*/5 * * * *`` ran once; never two recalibrations of a machine at a time."""
    slots = _rows(database, sa.select(schedule_store.schedule_slots).order_by(schedule_store.schedule_slots.c.slot))
    schedule = _rows(database, sa.select(schedule_store.schedules))[0]
    first = datetime.fromisoformat(schedule.created).replace(second=0, microsecond=0)
    found = [slot.slot for slot in slots]
    expected: list[str] = []
    moment = first
    while found and (not expected or expected[-1] < found[-1]):
        moment += timedelta(minutes=1)
        if moment.minute % 5 == 0:
            expected.append(moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"))
    wrong = sorted(set(found) - set(expected)) + [slot for slot, count in Counter(found).items() if count != 1]
    for slot in sorted(set(expected) - set(found)):
        later = [row.state for row in slots if row.slot > slot][: KEPT - 1]
        if later != ["coalesced"] * (KEPT - 1):  # else it was one of so many missed at once that only these are kept
            wrong.append(slot)
    ordered = [slot.job for slot in slots if slot.state == "ordered"]
    table = recalibration_store.recalibrations
    made = _rows(database, sa.select(table.c.job).where(table.c.schedule.is_not(None)))
    if sorted(row.job for row in made) != sorted(ordered):
        wrong.append(f"{len(made)} recalibrations for {len(ordered)} slots")
    yield _none("slots that had their turn once", wrong, len(slots))
    states = Counter(slot.state for slot in slots)
    yield Check("slots by state", len(slots), ", ".join(f"{count} {state}" for state, count in sorted(states.items())))
    query = sa.select(job_store.jobs.c.id).where(job_store.jobs.c.kind == "recalibration")
    yield _none("recalibrations one at a time", _counted(database, TOGETHER), len(_rows(database, query)))


def _integrity(database: Database, noted: Acknowledged) -> Iterator[Check]:
    """Check the audit log's chain, and the database itself."""
    found = Audit(database).verify()
    acknowledged = len(noted.orders) + len(noted.rows)
    whole = found.intact and found.entries >= acknowledged
    yield fact("audit chain intact", whole, f"{found.entries} entries, {acknowledged} acknowledged actions")
    if database.is_sqlite:
        with database.read() as connection:
            answer = [str(row[0]) for row in connection.exec_driver_sql("PRAGMA integrity_check")]
            foreign = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
        yield fact("database integrity", answer == ["ok"] and not foreign, f"{answer[0]}, {len(foreign)} dangling keys")


def amcheck(url: str, programs: Path) -> Check:
    """Run PostgreSQL's own check of its tables and indexes (pg_amcheck)."""
    done = subprocess.run(
        [str(programs / "pg_amcheck"), "--install-missing", "--heapallindexed", "-U", OWNER, url],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    answer = " ".join((done.stdout + done.stderr).split())
    return fact("database integrity", done.returncode == 0, answer[:200] or "pg_amcheck finds nothing")
