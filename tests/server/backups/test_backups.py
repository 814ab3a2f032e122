"""Backups: whole, restorable, refused when damaged; daily ones are made and removed by the clock."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import sqlite3
import threading
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from service_fakes import MACHINE, Fakes, running_service

import server.backups.backup_archive
from server.backups.backup_archive import KEPT, MANIFEST, Backups, restore
from server.backups.backup_files import BackupContent
from server.commands.command_line import main
from server.composition.declarations import RESOURCES, TABLES
from server.identifications.identification_store import Identifications, identifications
from server.jobs.job_store import Jobs, jobs
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.database.schema import SCHEMA_VERSION
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.recordings.recording_store import RecordingRow, Recordings

CONTENT = BackupContent.of(RESOURCES)


def contents(directory: Path) -> dict[str, bytes]:
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_backup_of_a_running_service_is_restored_elsewhere_and_jobs_are_there(tmp_path: Path, csv: bytes) -> None:
    data_dir = tmp_path / "data"
    with running_service(data_dir, Fakes()) as running:
        order = running.order(csv)
        assert running.follow(order.job)[-1]["state"] == "done"
        made = running.service[Backups].make()
        # What comes after the backup is not in it.
        running.upload(csv, "repeat")
        assert [backup.id for backup in running.service[Backups].list()] == [made.id]
    backup = data_dir / "backups" / made.id
    assert made.bytes == sum(len(content) for name, content in contents(backup).items() if name != "manifest.json")
    new = DataDirectory(tmp_path / "new")
    with new.locked():
        assert restore(backup, new, CONTENT, f"sqlite:///{new.database}") > 5
    with running_service(tmp_path / "new", Fakes()) as again:
        assert again.service[Jobs].get(order.job).state == "done"
        assert again.service[Identifications].get(order.id).verdict == "nothing_missing"
        rows = again.service[Recordings].list(10).items
        assert sorted(row.role for row in rows) == ["train", "validate"]
        assert all((again.service.files.recordings / f"{row.id}.{row.format}").is_file() for row in rows)
        second = again.order(csv)  # what was restored can be worked with
        assert again.follow(second.job)[-1]["state"] == "done"


def sealed_recording(id: str, database: Database) -> RecordingRow:
    return RecordingRow(
        id=id,
        machine="lever",
        machine_version=1,
        role="train",
        label="",
        state="sealed",
        origin="recorded",
        format="parquet",
        created=database.now(),
    )


@pytest.fixture
def files(tmp_path: Path) -> DataDirectory:
    """A store with a machine, and a recording's file."""
    files = DataDirectory(tmp_path / "data")
    database = Database(files.database, TABLES, changed=lambda: None)
    Machines(database).add("lever", 1, "hash")
    row = sealed_recording("rec-1", database)
    Recordings(database).add(row)
    with database.write() as connection:
        of_job = dict.fromkeys(("id", "subject"), "idn-1") | dict.fromkeys(("label", "text", "created"), "")
        kind = {"kind": "identification", "stages": [], "state": "done", "fraction": 1.0, "cancel_requested": False}
        connection.execute(jobs.insert().values(**of_job, **kind))
        made = {"id": "idn-1", "job": "idn-1", "machine": "lever", "machine_version": 1, "options": {}}
        connection.execute(identifications.insert().values(**made, label="", created=""))
    database.close()
    (files.machines / "lever").mkdir()
    (files.machines / "lever" / "1.yaml").write_text(MACHINE)
    (files.recordings / "rec-1.parquet").write_bytes(b"sealed")
    (files.recordings / "rec-2.journal").write_bytes(b"being recorded")
    return files


def backups_of(files: DataDirectory, now: list[datetime]) -> Backups:
    return Backups(files, CONTENT, f"sqlite:///{files.database}", lambda: now[0])


def test_what_is_being_written_is_left_out_and_a_log_that_goes_on_does_not_reach_the_backup(
    files: DataDirectory,
) -> None:
    log = files.identifications / "idn-1" / "check.log"
    log.parent.mkdir()
    log.write_text("first\n")
    backups = backups_of(files, [datetime(2026, 1, 1, tzinfo=UTC)])
    backup = backups.directory / backups.make().id
    with log.open("a") as file:
        file.write("second\n")
    assert (backup / "identifications" / "idn-1" / "check.log").read_text() == "first\n"
    assert sorted(path.name for path in (backup / "recordings").iterdir()) == ["rec-1.parquet"]
    restore(backup, files, CONTENT, f"sqlite:///{files.database}")
    assert log.read_text() == "first\n"


@pytest.mark.parametrize("harm", ["damaged", "missing", "no manifest"])
def test_a_harmed_backup_is_refused_and_nothing_is_changed(files: DataDirectory, harm: str) -> None:
    backups = backups_of(files, [datetime(2026, 1, 1, tzinfo=UTC)])
    backup = backups.directory / backups.make().id
    harmed = backup / ("manifest.json" if harm == "no manifest" else "store.sqlite")
    if harm == "damaged":
        content = bytearray(harmed.read_bytes())
        content[5000] ^= 1
        harmed.write_bytes(content)
    else:
        harmed.unlink()
    before = contents(files.recordings) | {"store": files.database.read_bytes()}
    with pytest.raises(StartError, match="backup"):
        restore(backup, files, CONTENT, f"sqlite:///{files.database}")
    assert contents(files.recordings) | {"store": files.database.read_bytes()} == before


@pytest.mark.slow
def test_one_a_day_and_old_ones_go_but_not_those_that_somebody_ordered(files: DataDirectory) -> None:
    now = [datetime(2026, 1, 1, tzinfo=UTC)]
    backups = backups_of(files, now)
    ordered = backups.make()
    assert backups.daily() is None, "there is one of today"
    for _ in range(KEPT + 3):
        now[0] += timedelta(hours=25)
        assert backups.daily() is not None
        assert backups.daily() is None
    now[0] -= timedelta(days=900)  # the clock was wrong, and somebody sets it right
    assert backups.daily() is not None, "one from a time to come is no reason to have none today"
    assert backups.daily() is None
    kept = [backup for backup in backups.list() if backup.created > "2026"]
    assert [backup.kind for backup in kept] == ["daily"] * KEPT + ["ordered"]
    assert kept[-1] == ordered


def test_a_backup_that_cannot_be_written_says_so_and_leaves_nothing(
    files: DataDirectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    backups = backups_of(files, [datetime(2026, 1, 1, tzinfo=UTC)])
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfile", full)
        with pytest.raises(StartError, match="No space left"):
            backups.make()
    assert list(backups.directory.iterdir()) == []


def test_a_file_that_is_deleted_during_the_copy_is_left_out_and_reported(
    files: DataDirectory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recording is deleted after the store was copied, and a stage clears its directory while that is walked."""
    place = files.identifications / "idn-1" / "2-cylinder_stage"
    for name in ("a.json", "deeper/b.json", "deeper/still/c.json"):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text("{}")
    database = Database(files.database, TABLES, changed=lambda: None)
    row = sealed_recording("rec-3", database)
    Recordings(database).add(row)
    database.close()
    (files.recordings / "rec-3.parquet").write_bytes(b"sealed")
    copy_database, copyfile = server.backups.backup_archive.copy_database, shutil.copyfile

    def copy_store(*arguments: Any) -> Path:
        copied = copy_database(*arguments)
        (files.recordings / "rec-3.parquet").unlink()
        return copied

    def copy_file(source: Path, target: Path) -> None:
        copyfile(source, target)
        if source.name == "a.json":
            shutil.rmtree(place)

    monkeypatch.setattr(server.backups.backup_archive, "copy_database", copy_store)
    monkeypatch.setattr(shutil, "copyfile", copy_file)
    main_ends_well(["backup", "--data-dir", str(files.root)])
    assert "1 files that the store names were not there: recordings/rec-3.parquet" in capsys.readouterr().out
    (made,) = backups_of(files, [datetime(2026, 1, 1, tzinfo=UTC)]).list()
    assert made.missing == ("recordings/rec-3.parquet",)
    backup = files.backups / made.id
    assert (backup / "identifications" / "idn-1" / "2-cylinder_stage" / "a.json").read_text() == "{}"
    assert (backup / "recordings" / "rec-1.parquet").read_bytes() == b"sealed"
    monkeypatch.undo()
    restore(backup, files, CONTENT, f"sqlite:///{files.database}")


@pytest.mark.slow
def test_a_backup_is_made_while_directories_come_and_go(files: DataDirectory) -> None:
    stop = threading.Event()

    def churn() -> None:
        number = 0
        while not stop.is_set():
            place = files.identifications / "idn-1" / f"{number % 7}-stage" / "deeper"
            place.mkdir(parents=True, exist_ok=True)
            (place / "result.json").write_text("{}")
            shutil.rmtree(files.identifications / "idn-1" / f"{(number + 3) % 7}-stage", ignore_errors=True)
            number += 1

    thread = threading.Thread(target=churn)
    thread.start()
    try:
        backups = Backups(files, CONTENT, f"sqlite:///{files.database}", lambda: datetime.now(UTC))
        for _ in range(15):
            assert backups.make().missing == ()
    finally:
        stop.set()
        thread.join()


def test_only_a_full_disk_is_called_full(files: DataDirectory, monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(shutil, "copyfile", gone)
    with pytest.raises(StartError, match="Read-only file system") as refusal:
        backups_of(files, [datetime(2026, 1, 1, tzinfo=UTC)]).make()
    assert "free some space" not in str(refusal.value)


def main_ends_well(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0


def test_backup_and_restore_as_commands(
    files: DataDirectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["backup", "--data-dir", str(files.root), "--output", str(tmp_path / "elsewhere")])
    assert ended.value.code == 0
    (backup,) = (tmp_path / "elsewhere").iterdir()
    assert str(backup) in capsys.readouterr().out.replace("\n", "")
    with pytest.raises(SystemExit) as ended:
        main(["restore", str(backup), "--data-dir", str(tmp_path / "new")])
    assert ended.value.code == 0
    database = Database(tmp_path / "new" / "hilfit.sqlite", TABLES, changed=lambda: None)
    assert Machines(database).get("lever").version == 1
    assert [row.id for row in Recordings(database).list(9).items] == ["rec-1"]
    database.close()
    with files.locked(), pytest.raises(SystemExit) as ended:
        main(["restore", str(backup), "--data-dir", str(files.root)])
    assert ended.value.code == 2
    assert "another hilfit server" in capsys.readouterr().err


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a command says that ends with exit code 2: one line."""
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    said = capsys.readouterr()
    assert (ended.value.code, said.out) == (2, "")
    (line,) = said.err.strip().splitlines()
    return line


def as_if_whole(backup: Path, name: str, **more: object) -> None:
    """Write a manifest in which a file is what it is now; ``more``: into the manifest."""
    manifest = json.loads((backup / MANIFEST).read_text())
    manifest["files"] = [entry for entry in manifest["files"] if entry["path"] != name]
    sha256 = hashlib.sha256((backup / name).read_bytes()).hexdigest()
    manifest["files"].append({"path": name, "sha256": sha256, "bytes": 0})
    (backup / MANIFEST).write_text(json.dumps(manifest | more))


def absent(backup: Path) -> None:
    shutil.rmtree(backup)


def a_file(backup: Path) -> None:
    shutil.rmtree(backup)
    backup.write_bytes(b"tar")


def empty(backup: Path) -> None:
    shutil.rmtree(backup)
    backup.mkdir()


def empty_manifest(backup: Path) -> None:
    (backup / MANIFEST).write_text("")


def cut_manifest(backup: Path) -> None:
    (backup / MANIFEST).write_text((backup / MANIFEST).read_text()[:100])


def other_manifest(backup: Path) -> None:
    (backup / MANIFEST).write_text("[1]")


def cut_store(backup: Path) -> None:
    os.truncate(backup / "store.sqlite", 6000)


def cut_store_that_was_copied_so(backup: Path) -> None:
    cut_store(backup)
    as_if_whole(backup, "store.sqlite")


def empty_store(backup: Path) -> None:
    os.truncate(backup / "store.sqlite", 0)
    as_if_whole(backup, "store.sqlite")


def outside(backup: Path) -> None:
    (backup.parent / "evil.yaml").write_text("name: evil")
    as_if_whole(backup, "../evil.yaml")


def through_a_folder(backup: Path) -> None:
    (backup.parent.parent / "evil.yaml").write_text("name: evil")
    as_if_whole(backup, "machines/../../../evil.yaml")


def absolute(backup: Path) -> None:
    (backup.parent / "evil.yaml").write_text("name: evil")
    as_if_whole(backup, str(backup.parent / "evil.yaml"))


def by_a_link(backup: Path) -> None:
    (backup.parent / "evil.yaml").write_text("name: evil")
    (backup / "machines" / "evil.yaml").symlink_to(backup.parent / "evil.yaml")
    as_if_whole(backup, "machines/evil.yaml")


def onto_the_lock(backup: Path) -> None:
    (backup / "lock").write_text("")
    as_if_whole(backup, "lock")


def newer_store(backup: Path) -> None:
    with closing(sqlite3.connect(backup / "store.sqlite")) as connection:
        connection.execute("UPDATE store_version SET version = version + 1")
        connection.commit()
    as_if_whole(backup, "store.sqlite")


def newer_manifest(backup: Path) -> None:
    as_if_whole(backup, "store.sqlite", store=SCHEMA_VERSION + 1)


def two_stores(backup: Path) -> None:
    (backup / "store.pgdump").write_bytes(b"PGDMP")
    as_if_whole(backup, "store.pgdump")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("harm", "says"),
    [
        (absent, "there is no such directory; give the directory of a backup"),
        (a_file, "is a file; give the directory of a backup"),
        (empty, "manifest.json is missing or damaged); use another backup"),
        (empty_manifest, "manifest.json is missing or damaged); use another backup"),
        (cut_manifest, "manifest.json is missing or damaged); use another backup"),
        (other_manifest, "manifest.json is missing or damaged); use another backup"),
        (cut_store, "store.sqlite is damaged; use another backup"),
        (cut_store_that_was_copied_so, "store.sqlite: is no copy of a store"),
        (empty_store, "store.sqlite: is no copy of a store"),
        (outside, "../evil.yaml has no place in a backup"),
        (through_a_folder, "machines/../../../evil.yaml has no place in a backup"),
        (absolute, "evil.yaml has no place in a backup"),
        (by_a_link, "machines/evil.yaml is missing; use another backup"),
        (onto_the_lock, "lock has no place in a backup"),
        (newer_store, "restore it with the hilfit that made it"),
        (newer_manifest, "restore it with the hilfit that made it"),
        (two_stores, "has no copy of the store; use another backup"),
    ],
)
def test_what_cannot_be_restored_is_said_in_one_line_and_nothing_is_changed(
    files: DataDirectory,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    harm: Callable[[Path], None],
    says: str,
) -> None:
    made = Backups(
        files, CONTENT, f"sqlite:///{files.database}", lambda: datetime(2026, 1, 1, tzinfo=UTC), tmp_path / "kept"
    )
    backup = made.directory / made.make().id
    harm(backup)
    with files.locked():  # else its file would be new
        before = contents(files.root)
    line = refused(capsys, "restore", str(backup), "--data-dir", str(files.root))
    assert str(backup) in line and says in line
    assert contents(files.root) == before
    assert sorted(path.name for path in files.root.parent.iterdir()) in (
        ["data", "kept"],
        ["data", "evil.yaml", "kept"],
    )


@pytest.mark.parametrize("breaks", ["copyfile", "replace"])
def test_a_disk_that_is_full_or_closed_while_restoring_changes_nothing(
    files: DataDirectory, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], breaks: str
) -> None:
    made = Backups(files, CONTENT, f"sqlite:///{files.database}", lambda: datetime(2026, 1, 1, tzinfo=UTC))
    backup = made.directory / made.make().id
    (files.machines / "lever" / "2.yaml").write_text("since then")
    with files.locked():
        before = contents(files.root)
    copied = []

    def fail(*arguments: str | Path) -> None:
        copied.append(arguments)
        if breaks == "replace":
            raise PermissionError(13, "Permission denied")
        if len(copied) == 2:
            raise OSError(28, "No space left on device")
        Path(arguments[1]).write_bytes(b"half")

    with monkeypatch.context() as patch:
        patch.setattr(*((shutil, "copyfile") if breaks == "copyfile" else (Path, "replace")), fail)
        line = refused(capsys, "restore", str(backup), "--data-dir", str(files.root))
    assert str(files.root) in line and "free some space, or give another --data-dir" in line
    assert contents(files.root) == before
    restore(backup, files, CONTENT, f"sqlite:///{files.database}")
    assert contents(files.root) == before | {"hilfit.sqlite": files.database.read_bytes()}


def test_a_directory_that_is_no_service_s_is_not_backed_up_and_gets_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in (tmp_path / "other", tmp_path / "absent"):
        (tmp_path / "other").mkdir(exist_ok=True)
        line = refused(capsys, "backup", "--data-dir", str(place))
        assert str(place) in line and "there is nothing to back up; name the service's directory" in line
    assert [path.name for path in tmp_path.rglob("*")] == ["other"]


def test_a_store_that_is_damaged_is_not_backed_up(
    files: DataDirectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.truncate(files.database, 6000)
    line = refused(capsys, "backup", "--data-dir", str(files.root), "--output", str(tmp_path / "kept"))
    assert "store.sqlite: the backup cannot be written" in line
    assert list((tmp_path / "kept").iterdir()) == []
