"""``/audit``: who did what."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from server.audit.audit_log import Audit, EntryResource, VerificationResource
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.bodies import Listed
from server.platform.http.route_parameters import BetweenDep, Cursor, Limit, ServiceDep, problems

router = APIRouter(
    prefix="/audit", tags=["audit"], dependencies=[require("admin", every_machine=True)], route_class=TypedRoute
)


class EntryList(Listed[EntryResource]):
    """A page of the audit log, newest first."""


@router.get("", responses=problems(422))
def list_entries(
    service: ServiceDep,
    between: BetweenDep,
    action: Annotated[str | None, Query(max_length=80, description="Beginning of the action")] = None,
    limit: Limit = 50,
    cursor: Cursor = 0,
) -> EntryList:
    """List the audit log, newest first; ``label`` is looked for in what it was done to."""
    return EntryList.of(service[Audit].list(limit, cursor, action=action, between=between))


@router.get("/verification")
async def verify(service: ServiceDep, principal: PrincipalDep) -> VerificationResource:
    """Compute the chain of hashes again: whether the log is as it was written."""
    return await service.heavy.run(principal.id, service[Audit].verify)
