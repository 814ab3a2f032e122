"""``/backups``: list them, make one."""

from __future__ import annotations

from fastapi import APIRouter, Response
from pydantic import BaseModel

from server.access.guard import require
from server.backups import Backup
from server.errors import ConflictError, StartError
from server.routes.common import ServiceDep, problems

router = APIRouter(prefix="/backups", tags=["backups"])


class BackupResource(BaseModel):
    """A backup; ``kind`` is daily or ordered. It is restored by ``hilfit restore``, with the service stopped."""

    id: str
    created: str
    bytes: int
    kind: str

    @classmethod
    def of(cls, backup: Backup) -> BackupResource:
        """From what is on disk."""
        return cls(**backup.__dict__)


class BackupList(BaseModel):
    """All backups, newest first."""

    items: list[BackupResource]
    next: None = None


@router.get("", dependencies=[require("admin", every_machine=True)])
def list_backups(service: ServiceDep) -> BackupList:
    """List backups, newest first."""
    return BackupList(items=[BackupResource.of(backup) for backup in service.backups.list()])


@router.post("", status_code=201, responses=problems(409), dependencies=[require("admin", every_machine=True)])
def make(response: Response, service: ServiceDep) -> BackupResource:
    """Make a backup now."""
    try:
        backup = service.backups.make()
    except StartError as error:
        raise ConflictError(str(error).replace(f"{service.files.root}/", "")) from None
    return BackupResource.of(backup)
