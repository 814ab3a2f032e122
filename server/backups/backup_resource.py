"""The resource ``backups``: copies of everything that cannot be made again."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel

from server.backups.backup_archive import BackupResource, Backups, DailyBackups
from server.backups.backup_files import BackupContent
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.database.engine import Database, utc_now
from server.platform.errors import ConflictError, StartError
from server.platform.files import DataDirectory
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import TROUBLES, Parts, Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings


class BackupList(BaseModel):
    """All backups, newest first."""

    items: list[BackupResource]
    next: None = None


router = APIRouter(prefix="/backups", tags=["backups"], route_class=TypedRoute)


@router.get("", dependencies=[require("admin", every_machine=True)])
def list_backups(service: ServiceDep) -> BackupList:
    """List backups, newest first."""
    return BackupList(items=list(service[Backups].list()))


@router.post("", status_code=201, responses=problems(409), dependencies=[require("admin", every_machine=True)])
async def make(service: ServiceDep, principal: PrincipalDep) -> BackupResource:
    """Make a backup now."""
    try:
        return await service.heavy.run(principal.id, service[Backups].make)
    except StartError as error:
        raise ConflictError(str(error).replace(f"{service.files.root}/", "")) from None


def _backups(parts: Parts) -> Backups:
    content = BackupContent.of(parts[Service].resources)
    directory = parts[Settings].backup_dir
    return Backups(parts[DataDirectory], content, parts[Database].url, utc_now, directory)


BACKUPS = Resource(
    name="backups",
    routers=(router,),
    provides={Backups: _backups, DailyBackups: lambda parts: DailyBackups(parts[Backups], parts[TROUBLES])},
    running=lambda parts: [Running(Phase.CLOCKS, parts[DailyBackups].rounds.start, parts[DailyBackups].rounds.stop)],
)
