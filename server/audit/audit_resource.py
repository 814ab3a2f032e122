"""The resource ``audit``: who did what."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Query

from server.audit.audit_log import Audit, EntryResource, VerificationResource, audit_log
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.database.engine import Database
from server.platform.http.bodies import Listed
from server.platform.http.route_parameters import PageDep, ServiceDep, problems
from server.platform.parts import TROUBLES, Parts
from server.platform.resource import Phase, Resource, Running

router = APIRouter(
    prefix="/audit", tags=["audit"], dependencies=[require("admin", every_machine=True)], route_class=TypedRoute
)


class EntryList(Listed[EntryResource]):
    """A page of the audit log, newest first."""


@router.get("", responses=problems(422))
def list_entries(
    service: ServiceDep,
    page: PageDep,
    action: Annotated[str | None, Query(max_length=80, description="Beginning of the action")] = None,
) -> EntryList:
    """List the audit log, newest first; ``label`` is looked for in what it was done to."""
    return EntryList.of(service[Audit].list(page["limit"], page["after"], action=action, between=page["between"]))


@router.get("/verification")
async def verify(service: ServiceDep, principal: PrincipalDep) -> VerificationResource:
    """Compute the chain of hashes again: whether the log is as it was written."""
    return await service.heavy.run(principal.id, service[Audit].verify)


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
