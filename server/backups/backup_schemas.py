"""What the routes of backups give."""

from __future__ import annotations

from pydantic import BaseModel

from server.platform.http.bodies import Shown


class BackupResource(Shown):
    """A backup; ``kind`` is daily or ordered. It is restored by ``hilfit restore``, with the service stopped.

    ``missing``: files that the store names and that were gone when they were to be copied.
    """

    id: str
    created: str
    bytes: int
    kind: str
    missing: list[str]


class BackupList(BaseModel):
    """All backups, newest first."""

    items: list[BackupResource]
    next: None = None
