"""Backups: whole, restorable, refused when damaged; daily ones are made and removed by the clock."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from service_fakes import MACHINE, Fakes, running_service

from server.backups import KEPT, Backups, restore
from server.cli import main
from server.errors import StartError
from server.files import DataDirectory
from server.store import Database, Machines, Recordings


def contents(directory: Path) -> dict[str, bytes]:
    return {str(path.relative_to(directory)): path.read_bytes() for path in directory.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_a_backup_of_a_running_service_is_restored_elsewhere_and_jobs_are_there(tmp_path: Path, csv: bytes) -> None:
    data_dir = tmp_path / "data"
    with running_service(data_dir, Fakes()) as running:
        order = running.order(csv)
        assert running.follow(order.job)[-1]["state"] == "done"
        made = running.service.backups.make()
        # What comes after the backup is not in it.
        running.upload(csv, "repeat")
        assert [backup.id for backup in running.service.backups.list()] == [made.id]
    backup = data_dir / "backups" / made.id
    assert made.bytes == sum(len(content) for name, content in contents(backup).items() if name != "manifest.json")
    new = DataDirectory(tmp_path / "new")
    with new.locked():
        assert restore(backup, new, f"sqlite:///{new.database}") > 5
    with running_service(tmp_path / "new", Fakes()) as again:
        assert again.service.jobs.get(order.job).state == "done"
        assert again.service.identifications.get(order.id).verdict == "nothing_missing"
        rows = again.service.recordings.list(10).items
        assert sorted(row.role for row in rows) == ["train", "validate"]
        assert all((again.service.files.recordings / f"{row.id}.{row.format}").is_file() for row in rows)
        second = again.order(csv)  # what was restored can be worked with
        assert again.follow(second.job)[-1]["state"] == "done"


@pytest.fixture
def files(tmp_path: Path) -> DataDirectory:
    """A store with a machine, and a recording's file."""
    files = DataDirectory(tmp_path / "data")
    database = Database(files.database, changed=lambda: None)
    Machines(database).add("lever", 1, "hash")
    database.close()
    (files.machines / "lever").mkdir()
    (files.machines / "lever" / "1.yaml").write_text(MACHINE)
    (files.recordings / "rec-1.parquet").write_bytes(b"sealed")
    (files.recordings / "rec-2.journal").write_bytes(b"being recorded")
    return files


def backups_of(files: DataDirectory, now: list[datetime]) -> Backups:
    return Backups(files, f"sqlite:///{files.database}", lambda: now[0])


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
    restore(backup, files, f"sqlite:///{files.database}")
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
        restore(backup, files, f"sqlite:///{files.database}")
    assert contents(files.recordings) | {"store": files.database.read_bytes()} == before


def test_one_a_day_and_old_ones_go_but_not_those_that_somebody_ordered(files: DataDirectory) -> None:
    now = [datetime(2026, 1, 1, tzinfo=UTC)]
    backups = backups_of(files, now)
    ordered = backups.make()
    assert backups.daily() is None, "there is one of today"
    for _ in range(KEPT + 3):
        now[0] += timedelta(hours=25)
        assert backups.daily() is not None
        assert backups.daily() is None
    kept = backups.list()
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


def test_the_commands(files: DataDirectory, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["backup", "--data-dir", str(files.root), "--output", str(tmp_path / "elsewhere")])
    assert ended.value.code == 0
    (backup,) = (tmp_path / "elsewhere").iterdir()
    assert str(backup) in capsys.readouterr().out.replace("\n", "")
    with pytest.raises(SystemExit) as ended:
        main(["restore", str(backup), "--data-dir", str(tmp_path / "new")])
    assert ended.value.code == 0
    database = Database(tmp_path / "new" / "hilfit.sqlite", changed=lambda: None)
    assert Machines(database).get("lever").version == 1
    assert Recordings(database).list(1).items == ()
    database.close()
    with files.locked(), pytest.raises(SystemExit) as ended:
        main(["restore", str(backup), "--data-dir", str(files.root)])
    assert ended.value.code == 2
    assert "another hilfit server" in capsys.readouterr().err
