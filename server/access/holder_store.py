"""Devices and API keys in the store.

A token has 256 random bits, so a plain SHA-256 of it can be kept: there is nothing to guess.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
from collections.abc import Callable, Sequence
from datetime import timedelta
from typing import Annotated, Literal

import sqlalchemy as sa

from server.platform.authorization.principals import Principal, Role
from server.platform.database.engine import Database, later
from server.platform.database.repository import Repository
from server.platform.database.stored import HIDDEN, Id, Kept, Stored
from server.platform.errors import ConflictError, NotFoundError, none_of

PREFIX = "hilfit_"
HolderKind = Literal["device", "key"]


class Holder(Stored, table="principals", label="name"):
    """A paired device or an API key; of its token only a hash is kept. No ``machines``: all, no ``expires``: never."""

    id: Id
    kind: HolderKind
    name: str
    role: Role
    machines: tuple[str, ...] | None
    secret_sha256: Annotated[str, Kept(unique=True), HIDDEN]
    created: str
    created_by: str
    expires: str | None = None

    @property
    def principal(self) -> Principal:
        """Principal of its token."""
        return Principal(self.id, self.name, self.role, self.machines, self.kind)


principals = Holder.table


class Holders(Repository[Holder]):
    """Repository of devices and keys.

    Parameters
    ----------
    removed : called with the id of each that is removed
    """

    of = Holder

    def __init__(self, database: Database, removed: Callable[[str], None] = lambda id: None) -> None:
        super().__init__(database)
        self._removed = removed
        self._lock = threading.Lock()
        self._known: dict[str, Holder] = {}
        self._changes = 0

    def add(
        self,
        kind: HolderKind,
        name: str,
        role: Role,
        machines: Sequence[str] | None,
        created_by: str,
        days: int | None = None,
    ) -> tuple[Holder, str]:
        """Store a new one; its token is known now and never again, and good for so many ``days`` (None: for ever)."""
        now = self._database.now()
        token = PREFIX + secrets.token_urlsafe(32)
        holder = Holder(
            id=f"{'dev' if kind == 'device' else 'key'}-{secrets.token_hex(8)}",
            kind=kind,
            name=name,
            role=role,
            machines=None if machines is None else tuple(machines),
            secret_sha256=_hash(token),
            created=now,
            created_by=created_by,
            expires=None if days is None else later(now, timedelta(days=days)),
        )
        with self._database.write("access") as connection:
            self.put(connection, holder)
        return holder, token

    def of_token(self, token: str) -> Holder | None:
        """Find who holds a token; None if nobody does, or it has expired."""
        hashed, changes = _hash(token), self._changes
        found = self.all(principals.c.secret_sha256 == hashed)
        if not found:
            return None
        (holder,) = found
        with self._lock:
            if changes == self._changes:  # else it may have been removed after it was read
                self._known[hashed] = holder
        return self._valid(holder)

    def known(self, token: str) -> Holder | None:
        """Find who holds a token among those known without asking the store; only the server changes holders."""
        holder = self._known.get(_hash(token))
        return None if holder is None else self._valid(holder)

    def _valid(self, holder: Holder) -> Holder | None:
        return holder if holder.expires is None or self._database.now() < holder.expires else None

    def _forget(self) -> None:
        with self._lock:
            self._changes += 1
            self._known = {}

    def known_as(self, kind: HolderKind, id: str) -> Holder:
        """Return the device or key; NotFoundError if there is none."""
        found = self.all(principals.c.id == id, principals.c.kind == kind)
        if not found:
            raise NotFoundError(none_of(kind, id))
        return found[0]

    def remove(self, id: str, kind: HolderKind) -> None:
        """Remove it; its token is worth nothing from now on.

        Raises
        ------
        NotFoundError
            If there is none.
        ConflictError
            If it is the last admin of all machines: nobody could pair another one.
        """
        holder = self.known_as(kind, id)
        with self._database.write("access") as connection:
            unbound = holder.role == "admin" and holder.machines is None and self._valid(holder) is not None
            if unbound and self._admins(connection) == 1:
                raise ConflictError("server.last_admin", kind=kind, id=id).about("last_admin")
            connection.execute(principals.delete().where(principals.c.id == id))
        self._forget()
        self._removed(id)

    def has_admin(self) -> bool:
        """Test whether anybody can pair others."""
        with self._database.read() as connection:
            return self._admins(connection) > 0

    def _admins(self, connection: sa.Connection) -> int:
        valid = sa.or_(principals.c.expires.is_(None), principals.c.expires > self._database.now())
        query = sa.select(sa.func.count()).where(principals.c.role == "admin", principals.c.machines.is_(None), valid)
        return int(connection.execute(query).scalar_one())


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()
