"""The resource ``backups``: copies of everything that cannot be made again."""

from __future__ import annotations

from collections.abc import Iterator

from server.backups.backup_archive import Backups, DailyBackups
from server.backups.backup_files import BackupContent
from server.backups.backup_routes import router
from server.platform.database.engine import Database, utc_now
from server.platform.files import DataDirectory
from server.platform.parts import TROUBLES, Parts
from server.platform.resource import Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings


def _backups(parts: Parts) -> Backups:
    content = BackupContent.of(parts[Service].resources)
    directory = parts[Settings].backup_dir
    return Backups(parts[DataDirectory], content, parts[Database].url, utc_now, directory)


def _running(parts: Parts) -> Iterator[Running]:
    daily = parts[DailyBackups]
    yield Running(Phase.CLOCKS, daily.rounds.start, daily.rounds.stop)


BACKUPS = Resource(
    name="backups",
    routers=(router,),
    provides={Backups: _backups, DailyBackups: lambda parts: DailyBackups(parts[Backups], parts[TROUBLES])},
    running=_running,
)
