"""``/backups``: list them, make one."""

from __future__ import annotations

from fastapi import APIRouter

from server.backups.backup_archive import Backups
from server.backups.backup_schemas import BackupList, BackupResource
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import ConflictError, StartError
from server.platform.http.route_parameters import ServiceDep, problems

router = APIRouter(prefix="/backups", tags=["backups"], route_class=TypedRoute)


@router.get("", dependencies=[require("admin", every_machine=True)])
def list_backups(service: ServiceDep) -> BackupList:
    """List backups, newest first."""
    return BackupList(items=[BackupResource.of(backup) for backup in service[Backups].list()])


@router.post("", status_code=201, responses=problems(409), dependencies=[require("admin", every_machine=True)])
async def make(service: ServiceDep, principal: PrincipalDep) -> BackupResource:
    """Make a backup now."""
    try:
        backup = await service.heavy.run(principal.id, service[Backups].make)
    except StartError as error:
        raise ConflictError(str(error).replace(f"{service.files.root}/", "")) from None
    return BackupResource.of(backup)
