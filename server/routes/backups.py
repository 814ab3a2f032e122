"""``/backups``: list them, make one."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel

from server.access.guard import PrincipalDep, require
from server.access.route import TypedRoute
from server.backups import Backup
from server.errors import ConflictError, StartError
from server.routes.common import ServiceDep, problems

router = APIRouter(prefix="/backups", tags=["backups"], route_class=TypedRoute)


class BackupResource(BaseModel):
    """A backup; ``kind`` is daily or ordered. It is restored by ``hilfit restore``, with the service stopped.

    ``missing``: files that the store names and that were gone when they were to be copied.
    """

    id: str
    created: str
    bytes: int
    kind: str
    missing: list[str]

    @classmethod
    def of(cls, backup: Backup) -> BackupResource:
        """From what is on disk."""
        return cls(**{**backup.__dict__, "missing": list(backup.missing)})


class BackupList(BaseModel):
    """All backups, newest first."""

    items: list[BackupResource]
    next: None = None


@router.get("", dependencies=[require("admin", every_machine=True)])
def list_backups(service: ServiceDep) -> BackupList:
    """List backups, newest first."""
    return BackupList(items=[BackupResource.of(backup) for backup in service.backups.list()])


@router.post("", status_code=201, responses=problems(409), dependencies=[require("admin", every_machine=True)])
async def make(service: ServiceDep, principal: PrincipalDep) -> BackupResource:
    """Make a backup now."""
    try:
        backup = await service.heavy.run(principal.id, service.backups.make)
    except StartError as error:
        raise ConflictError(str(error).replace(f"{service.files.root}/", "")) from None
    return BackupResource.of(backup)
