"""A store that was emptied, replaced, set back or damaged is none to go on with; a marker outside of it can tell."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from service_fakes import Fakes

from server.alarms.alarm_desk import Alarms
from server.alarms.alarm_resource import DAMAGE_LOOK_S, Watch
from server.audit.audit_resource import Audit
from server.backups.backup_archive import Backups, DailyBackups, restore
from server.backups.backup_files import BackupContent
from server.composition.declarations import RESOURCES
from server.platform.database.engine import Database, utc_now
from server.platform.database.site_marker import SiteMarker
from server.platform.errors import StartError, UnavailableError
from server.platform.files import DataDirectory
from server.platform.resource import TROUBLES, tables_of
from server.platform.service import Service
from server.platform.settings import Settings

TABLES = tables_of(RESOURCES)


class Site:
    """A data directory, opened again and again."""

    def __init__(self, root: Path) -> None:
        self.files = DataDirectory(root)

    def open(self, new_store: bool = False) -> Database:
        site = SiteMarker(self.files.root, self.files.backups, new_store)
        return Database(self.files.database, TABLES, changed=lambda: None, site=site)

    def used(self) -> None:
        with closing(self.open()) as database:
            for number in range(3):
                Audit(database).write("somebody", "test.done", str(number))

    def tamper(self, *statements: str) -> None:
        """As somebody who gets at the file."""
        with closing(sqlite3.connect(self.files.database)) as connection, connection:
            for event in ("update", "delete"):
                connection.execute(f"DROP TRIGGER IF EXISTS audit_log_no_{event}")
            for statement in statements:
                connection.execute(statement)


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path / "data")


@pytest.mark.parametrize("how", ["truncated", "deleted"])
def test_an_emptied_store_is_no_new_site(site: Site, how: str) -> None:
    site.used()
    backup = site.files.backups / "2026-06-01T020000.000Z"
    backup.mkdir(parents=True)
    (backup / "manifest.json").write_text("{}")
    if how == "truncated":
        site.files.database.write_bytes(b"")
    else:
        site.files.database.unlink()
    with pytest.raises(StartError, match=r"holds no store.*restore .*2026-06-01T020000\.000Z.*--new-store"):
        site.open()
    site.open(new_store=True).close()
    site.open().close()


def test_files_of_a_site_are_enough_to_refuse_a_new_store(site: Site) -> None:
    path = site.files.machine_file("arm", 1)
    path.parent.mkdir(parents=True)
    path.write_text("name: arm")
    with pytest.raises(StartError, match="holds no store"):
        site.open()


def test_a_first_start_that_was_killed_begins_again(site: Site) -> None:
    site.files.database.write_bytes(b"")
    (site.files.root / "lock").write_bytes(b"")
    site.open().close()


def test_the_store_of_another_site_is_refused_and_a_restored_one_taken(site: Site, tmp_path: Path) -> None:
    site.used()
    content = BackupContent.of(RESOURCES)
    url = f"sqlite:///{site.files.database}"
    made = Backups(site.files, content, url, utc_now).make()
    other = Site(tmp_path / "other")
    other.used()
    other.files.database.replace(site.files.database)
    with pytest.raises(StartError, match="another store than the one of this site"):
        site.open()
    restore(site.files.backups / made.id, site.files, content, url)
    with closing(site.open()) as database:
        assert Audit(database).verify().intact


def test_a_store_from_before_markers_gets_one(site: Site) -> None:
    site.used()
    (site.files.root / "site.json").unlink()
    site.tamper("DROP TABLE store_identity")
    site.open().close()
    site.files.database.write_bytes(b"")
    with pytest.raises(StartError, match="holds no store"):
        site.open()


def test_a_marker_that_cannot_be_read_says_so(site: Site) -> None:
    site.used()
    (site.files.root / "site.json").write_text("{")
    with pytest.raises(StartError, match=r"site\.json: cannot be read"):
        site.open()


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM audit_log WHERE number = 3",
        "UPDATE audit_log SET hash = 'x' WHERE number = 3",
        "DELETE FROM audit_log",
    ],
)
def test_an_audit_log_that_was_cut_shows_against_the_marker(site: Site, statement: str) -> None:
    site.used()
    with closing(site.open()) as database:
        assert not Audit(database).was_cut()
        assert Audit(database).verify().intact
    site.tamper(statement)
    with closing(site.open()) as database:
        assert Audit(database).was_cut()
        assert not Audit(database).verify().intact


@pytest.fixture
def damaged(tmp_path: Path) -> Iterator[Service]:
    site = Site(tmp_path / "data")
    site.used()
    site.tamper("CREATE TABLE filler (x)", *["INSERT INTO filler VALUES (randomblob(3000))"] * 40)
    content = bytearray(site.files.database.read_bytes())
    for page in range(len(content) // 4096 - 12, len(content) // 4096 - 6):
        content[page * 4096 : page * 4096 + 64] = b"\xff" * 64
    site.files.database.write_bytes(content)
    service = Service(Settings(data_dir=site.files.root), RESOURCES, Fakes().parts)
    yield service
    service.close()


def test_a_damaged_store_is_not_ready_and_is_an_alarm(damaged: Service) -> None:
    with pytest.raises(UnavailableError, match="the store is damaged"):
        damaged.check()
    damaged[Watch].service()
    assert [(alarm.kind, alarm.severity) for alarm in damaged[Alarms].active()] == [("store_damaged", "critical")]


def test_a_store_is_looked_through_every_day() -> None:
    now, looks = [0.0], []

    class Quiet:
        def report(self, *_: object) -> None: ...

    watch = Watch(None, Quiet(), lambda: 0, lambda: None, {}, lambda: looks.append(now[0]), monotonic=lambda: now[0])  # type: ignore[arg-type]
    for now[0] in (1.0, DAMAGE_LOOK_S - 1, DAMAGE_LOOK_S, DAMAGE_LOOK_S + 1, 2 * DAMAGE_LOOK_S):
        watch.service()
    assert looks == [DAMAGE_LOOK_S, 2 * DAMAGE_LOOK_S]


def test_a_backup_that_fails_is_an_alarm_until_one_is_made(tmp_path: Path) -> None:
    service = Service(Settings(data_dir=tmp_path / "data"), RESOURCES, Fakes().parts)
    try:
        service.files.backups.write_text("in the way")
        daily = DailyBackups(service[Backups], service[TROUBLES])
        daily.look()
        service[Watch].service()
        assert [alarm.kind for alarm in service[Alarms].active()] == ["backup_failed"]
        service.files.backups.unlink()
        daily.look()
        service[Watch].service()
        assert service[Alarms].active() == ()
    finally:
        service.close()
