"""The resource ``audit``: who did what."""

from __future__ import annotations

from collections.abc import Iterator

from server.audit.audit_log import Audit, audit_log
from server.audit.audit_routes import router
from server.platform.database.engine import Database
from server.platform.parts import TROUBLES, Parts
from server.platform.resource import Phase, Resource, Running


def _running(parts: Parts) -> Iterator[Running]:
    def look() -> None:
        if parts[Audit].was_cut():
            parts[TROUBLES]["audit_cut"] = "the audit log is not the one that this site wrote; compare it with a backup"

    yield Running(Phase.RECOVERY, look)


AUDIT = Resource(
    name="audit",
    routers=(router,),
    tables=(audit_log,),
    provides={Audit: lambda parts: Audit(parts[Database])},
    running=_running,
)
