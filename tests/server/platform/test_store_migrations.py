"""A store of version 1 is copied, then brought up to date; the copy is what it was."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa

from server.calibrations.calibration_content import Content
from server.calibrations.calibration_store import CalibrationStore
from server.composition.declarations import TABLES
from server.identifications.identification_results import IdentificationResults
from server.jobs.job_store import Jobs
from server.platform.authorization.principals import LOCAL
from server.platform.database import schema
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey, earlier
from server.platform.errors import ConflictError, StartError
from server.platform.files import DataDirectory
from server.valves.valve_fits import ValveFit

#: What version 1 had and version 2 changed, as SQLAlchemy wrote it then, with the tables that it points to.
VERSION_1 = """
CREATE TABLE store_version (version INTEGER NOT NULL, PRIMARY KEY (version));
INSERT INTO store_version VALUES (1);
CREATE TABLE revisions (resource VARCHAR NOT NULL, number INTEGER NOT NULL, PRIMARY KEY (resource));
INSERT INTO revisions VALUES ('jobs', 7);
CREATE TABLE machines (number INTEGER NOT NULL, name VARCHAR NOT NULL, version INTEGER NOT NULL,
  acquire BOOLEAN NOT NULL, PRIMARY KEY (number), UNIQUE (name));
INSERT INTO machines VALUES (1, 'lever', 1, 0);
CREATE TABLE jobs (number INTEGER NOT NULL, id VARCHAR NOT NULL, kind VARCHAR NOT NULL, label VARCHAR NOT NULL,
  subject VARCHAR NOT NULL, stages JSON NOT NULL, state VARCHAR NOT NULL, stage VARCHAR, fraction FLOAT NOT NULL,
  text VARCHAR NOT NULL, error VARCHAR, cancel_requested BOOLEAN NOT NULL, created VARCHAR NOT NULL,
  started VARCHAR, ended VARCHAR, PRIMARY KEY (number), UNIQUE (id));
INSERT INTO jobs VALUES (1, 'job-1', 'identification', '', 'idn-1', '["check"]', 'done', 'check', 1.0, 'Done', NULL, 0,
  '2026-01-01T00:00:00.000Z', NULL, NULL);
CREATE TABLE identifications (number INTEGER NOT NULL, id VARCHAR NOT NULL, job VARCHAR NOT NULL,
  machine VARCHAR NOT NULL, machine_version INTEGER NOT NULL, label VARCHAR NOT NULL, options JSON NOT NULL,
  verdict VARCHAR, overall JSON, created VARCHAR NOT NULL, PRIMARY KEY (number), UNIQUE (id), UNIQUE (job),
  FOREIGN KEY(job) REFERENCES jobs (id), FOREIGN KEY(machine) REFERENCES machines (name));
INSERT INTO identifications VALUES (1, 'idn-1', 'job-1', 'lever', 1, '', '{}', NULL, NULL, '2026-01-01T00:00:00.000Z');
CREATE TABLE idempotency_keys (key VARCHAR NOT NULL, request_sha256 VARCHAR NOT NULL, identification VARCHAR NOT NULL,
  created VARCHAR NOT NULL, PRIMARY KEY (key), FOREIGN KEY(identification) REFERENCES identifications (id));
INSERT INTO idempotency_keys VALUES ('tablet-1', 'hash', 'idn-1', '2026-01-01T00:00:00.000Z');
"""


#: Calibrations as they were until version 5, each of an identification.
CALIBRATIONS_5 = """
CREATE TABLE calibrations (number INTEGER NOT NULL, id VARCHAR NOT NULL, revision INTEGER NOT NULL,
  machine VARCHAR NOT NULL, identification VARCHAR NOT NULL, label VARCHAR NOT NULL, state VARCHAR NOT NULL,
  proposed_by VARCHAR NOT NULL, proposed_by_id VARCHAR NOT NULL, approved_by VARCHAR, created VARCHAR NOT NULL,
  activated VARCHAR, verdict VARCHAR NOT NULL, overall JSON NOT NULL, errors JSON NOT NULL, parameters JSON NOT NULL,
  model JSON NOT NULL, note VARCHAR NOT NULL, PRIMARY KEY (number), UNIQUE (id),
  FOREIGN KEY(machine) REFERENCES machines (name), UNIQUE (identification),
  FOREIGN KEY(identification) REFERENCES identifications (id));
INSERT INTO calibrations VALUES (1, 'cal-1', 1, 'lever', 'idn-1', 'spring', 'active', 'A', 'prn-1', 'B',
  '2026-01-01T00:00:00.000Z', '2026-01-02T00:00:00.000Z', 'nothing_missing', '{}', '{}', '[]', '{}', '');
CREATE TABLE calibration_activations (number INTEGER NOT NULL, machine VARCHAR NOT NULL, calibration VARCHAR NOT NULL,
  time VARCHAR NOT NULL, undone BOOLEAN NOT NULL, PRIMARY KEY (number),
  FOREIGN KEY(machine) REFERENCES machines (name), FOREIGN KEY(calibration) REFERENCES calibrations (id));
INSERT INTO calibration_activations VALUES (1, 'lever', 'cal-1', '2026-01-02T00:00:00.000Z', 0);
"""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "hilfit.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(VERSION_1)
    return path


def version(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        return int(connection.execute("SELECT version FROM store_version").fetchone()[0])


def test_what_was_there_is_there_and_the_copy_is_what_it_was(old: Path) -> None:
    database = Database(old, TABLES, changed=lambda: None)
    with database.read() as connection:
        assert earlier(connection, IdempotencyKey("tablet-1", "hash")) == "idn-1"
        with pytest.raises(ConflictError):
            earlier(connection, IdempotencyKey("tablet-1", "another"))
    assert database.revisions() == {"jobs": 7}
    assert Jobs(database).get("job-1").place is None
    directory = IdentificationResults(database, DataDirectory(old.parent)).directory("idn-1")
    assert directory == old.parent / "identifications" / "idn-1", "where it left its files then"
    database.close()
    assert version(old) == schema.SCHEMA_VERSION
    (copy,) = (old.parent / "backups").iterdir()
    assert version(copy) == 1
    with closing(sqlite3.connect(copy)) as connection:
        assert connection.execute("SELECT identification FROM idempotency_keys").fetchall() == [("idn-1",)]


def test_a_calibration_may_be_of_valves_in_a_store_in_which_none_could(old: Path) -> None:
    with closing(sqlite3.connect(old)) as connection:
        connection.executescript(CALIBRATIONS_5)
    database = Database(old, TABLES, changed=lambda: None)
    store = CalibrationStore(database)
    (kept,) = store.list(10).items
    assert (kept.id, kept.kind, kept.source, kept.valves) == ("cal-1", "identification", "idn-1", None)
    source = ValveFit(
        id="vlv-1", job="job-1", machine="lever", machine_version=1, label="", recordings=(), options={}, created=""
    )
    with database.write("valves") as connection:
        connection.execute(ValveFit.table.insert().values(**source.columns()))
    content = Content("nothing_missing", {}, {}, [], {})
    made, new = store.add(source, "valves", content, LOCAL, "valves")
    assert new and (made.kind, made.source, made.identification) == ("valves", "vlv-1", None)
    with pytest.raises(sa.exc.IntegrityError), database.write("valves") as connection:
        row = made.but(id="cal-2").columns()
        connection.execute(store.of.table.insert().values(**row))
    store.decide(made.id, "approved", LOCAL, "", None)
    store.activate(made.id, None, LOCAL)
    in_use = [store.active("lever", of) for of in ("identification", "valves")]
    assert [own and own.id for own in in_use] == ["cal-1", made.id]
    database.close()
    with closing(sqlite3.connect(old)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert connection.execute("PRAGMA foreign_key_check").fetchall() == []


def test_a_store_that_is_up_to_date_is_not_copied(old: Path) -> None:
    for _ in range(2):
        Database(old, TABLES, changed=lambda: None).close()
    assert len(list((old.parent / "backups").iterdir())) == 1


def test_without_a_backup_there_is_no_migration(old: Path) -> None:
    (old.parent / "backups").write_text("a file where the directory should be")
    with pytest.raises(StartError, match="backup cannot be written"):
        Database(old, TABLES, changed=lambda: None)
    assert version(old) == 1


def test_a_migration_that_fails_changes_nothing(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def break_off(*_: object, **__: object) -> None:
        raise RuntimeError("a bug")

    with monkeypatch.context() as patch:
        patch.setattr(schema.metadata, "create_all", break_off)
        with pytest.raises(RuntimeError, match="a bug"):
            Database(old, TABLES, changed=lambda: None)
    with closing(sqlite3.connect(old)) as connection:
        assert connection.execute("SELECT identification FROM idempotency_keys").fetchall() == [("idn-1",)]
    assert version(old) == 1
