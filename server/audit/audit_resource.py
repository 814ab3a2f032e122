"""The resource ``audit``: who did what, in a log that is only added to."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import APIRouter, Query
from pydantic import BeforeValidator

from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database, Page, page
from server.platform.database.migrations import AUDIT_APPEND_ONLY
from server.platform.database.repository import ANY_TIME, Between
from server.platform.database.schema import metadata
from server.platform.database.site_marker import Noted
from server.platform.http.bodies import Listed, Shown
from server.platform.http.route_parameters import PageDep, ServiceDep, problems
from server.platform.resource import TROUBLES, Parts, Phase, Resource, Running


class EntryResource(Shown):
    """An entry of the audit log; ``hash`` covers it and the hash of the entry before."""

    number: int
    time: str
    principal: str
    action: str
    subject: str
    detail: Annotated[dict[str, Any], BeforeValidator(json.loads)]
    hash: str


class VerificationResource(Shown):
    """Whether the log is as it was written.

    ``entries`` and ``last_hash``, noted elsewhere, also show later whether the newest entries were cut off.
    """

    intact: bool
    first_broken: int | None  # number of the first entry that does not fit
    entries: int
    last_hash: str | None


#: Rows are added, never changed; the database refuses it.
audit_log = sa.Table(
    "audit_log",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),  # 1, 2, ... without a gap
    sa.Column("time", sa.String, nullable=False),
    sa.Column("principal", sa.String, nullable=False),
    sa.Column("action", sa.String, nullable=False),
    sa.Column("subject", sa.String, nullable=False),
    sa.Column("detail", sa.String, nullable=False),  # JSON as it was hashed
    sa.Column("hash", sa.String, nullable=False),
)
_APPEND_ONLY = {
    "sqlite": tuple(
        f"CREATE TRIGGER audit_log_no_{event.lower()} BEFORE {event} ON audit_log "
        "BEGIN SELECT RAISE(ABORT, 'the audit log is append-only'); END"
        for event in ("UPDATE", "DELETE")
    ),
    "postgresql": AUDIT_APPEND_ONLY,
}
_ddl: Any = sa.DDL  # its constructor has no types
for _dialect, _statements in _APPEND_ONLY.items():
    for _statement in _statements:
        sa.event.listen(audit_log, "after_create", _ddl(_statement).execute_if(dialect=_dialect))


class Audit:
    """Writes, reads and verifies the log.

    Entry n holds ``h_n = SHA-256(h_(n-1) || 0x0A || c_n)``, with ``h_0`` empty and ``c_n`` the entry as JSON with
    sorted keys. A changed, removed or inserted entry breaks the chain there; that the newest entries were cut off shows
    against the number and hash in the site's marker, outside the store (:mod:`server.platform.database.site_marker`).
    The database refuses to change or delete rows (a trigger); the chain is for whoever gets around that.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def write(
        self, principal: Principal | str, action: str, subject: str, detail: Mapping[str, Any] | None = None
    ) -> None:
        """Add an entry.

        Parameters
        ----------
        principal : who did it, or a name for what is no principal
        action : what was done, ``<resource>.<verb>``
        subject : id of what it was done to
        detail : anything that JSON can hold; no secrets
        """
        who = principal if isinstance(principal, str) else f"{principal.name} ({principal.id})"
        text = json.dumps(dict(detail or {}), sort_keys=True)
        with self._database.write("audit") as connection:
            last = connection.execute(
                sa.select(audit_log.c.number, audit_log.c.hash).order_by(audit_log.c.number.desc()).limit(1)
            ).first()
            values = {
                "number": 1 if last is None else last.number + 1,
                "time": self._database.now(),
                "principal": who,
                "action": action,
                "subject": subject,
                "detail": text,
            }
            chained = _chained("" if last is None else last.hash, values)
            connection.execute(audit_log.insert().values(**values, hash=chained))
        if self._database.site is not None:
            self._database.site.note(int(str(values["number"])), chained)

    def list(
        self, limit: int, after: int = 0, *, action: str | None = None, between: Between = ANY_TIME
    ) -> Page[EntryResource]:
        """List newest first; ``action``: those that begin with it; ``between``: of a time, with part of the subject."""
        query = between.narrowed(sa.select(audit_log), audit_log.c.time, audit_log.c.subject)
        if action is not None:
            query = query.where(audit_log.c.action.startswith(action, autoescape=True))
        with self._database.read() as connection:
            rows, cursor = page(connection, query, audit_log.c.number, limit, after)
        return Page(tuple(EntryResource.of(row) for row in rows), cursor)

    def verify(self) -> VerificationResource:
        """Compute the whole chain again."""
        before, expected, noted = "", 1, self._noted
        with self._database.read() as connection:
            for row in connection.execute(sa.select(audit_log).order_by(audit_log.c.number)):
                values = {key: value for key, value in row._mapping.items() if key != "hash"}
                fits = row.number != noted.number or row.hash == noted.hash
                if row.number != expected or row.hash != _chained(before, values) or not fits:
                    return _verified(int(row.number), expected, before)
                before, expected = row.hash, expected + 1
        cut = noted.number >= expected
        return _verified(expected if cut else None, expected, before)

    def was_cut(self) -> bool:
        """Test whether the entry that the site's marker knows as the last is missing, or another."""
        noted = self._noted
        with self._database.read() as connection:
            query = sa.select(audit_log.c.hash).where(audit_log.c.number == noted.number)
            return bool(noted.number) and connection.execute(query).scalar() != noted.hash

    @property
    def _noted(self) -> Noted:
        site = self._database.site
        return (site.read() if site is not None else None) or Noted("")


def _verified(broken: int | None, expected: int, last: str) -> VerificationResource:
    return VerificationResource(
        intact=broken is None, first_broken=broken, entries=expected - 1, last_hash=last or None
    )


def _chained(before: str, values: Mapping[str, Any]) -> str:
    content = json.dumps(values, sort_keys=True)
    return hashlib.sha256(f"{before}\n{content}".encode()).hexdigest()


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
