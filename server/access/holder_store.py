"""Devices and API keys in the store.

A token has 256 random bits, so a plain SHA-256 of it can be kept: there is nothing to guess.
"""

from __future__ import annotations

import hashlib
import secrets
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

import sqlalchemy as sa

from server.access.access_tables import principals
from server.platform.authorization.principals import Principal, Role
from server.platform.database.engine import Database, Page, page
from server.platform.database.lists import ANY_TIME, Between
from server.platform.errors import ConflictError, NotFoundError

PREFIX = "hilfit_"


@dataclass(frozen=True)
class Holder:
    """A paired device or an API key."""

    id: str
    kind: Literal["device", "key"]
    name: str
    role: Role
    machines: tuple[str, ...] | None
    created: str
    created_by: str
    expires: str | None = None

    @property
    def principal(self) -> Principal:
        """Whom its token stands for."""
        return Principal(self.id, self.name, self.role, self.machines, self.kind)


class Holders:
    """Repository of devices and keys.

    Parameters
    ----------
    removed : called with the id of each that is removed
    """

    def __init__(self, database: Database, removed: Callable[[str], None] = lambda id: None) -> None:
        self._database = database
        self._removed = removed
        self._lock = threading.Lock()
        self._known: dict[str, Holder] = {}
        self._changes = 0

    def add(
        self,
        kind: Literal["device", "key"],
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
            f"{'dev' if kind == 'device' else 'key'}-{secrets.token_hex(8)}",
            kind,
            name,
            role,
            None if machines is None else tuple(machines),
            now,
            created_by,
            None if days is None else later(now, timedelta(days=days)),
        )
        values = {**holder.__dict__, "machines": None if machines is None else list(machines)}
        with self._database.write("access") as connection:
            connection.execute(principals.insert().values(**values, secret_sha256=_hash(token)))
        return holder, token

    def of_token(self, token: str) -> Holder | None:
        """Who holds a token; None if nobody does, or it has expired."""
        hashed, changes = _hash(token), self._changes
        with self._database.read() as connection:
            row = connection.execute(sa.select(principals).where(principals.c.secret_sha256 == hashed)).first()
        if row is None:
            return None
        holder = _holder(row)
        with self._lock:
            if changes == self._changes:  # else it may have been removed after it was read
                self._known[hashed] = holder
        return self._valid(holder)

    def known(self, token: str) -> Holder | None:
        """Who holds a token, as far as this process knows without asking the store; only the server changes holders."""
        holder = self._known.get(_hash(token))
        return None if holder is None else self._valid(holder)

    def _valid(self, holder: Holder) -> Holder | None:
        return holder if holder.expires is None or self._database.now() < holder.expires else None

    def _forget(self) -> None:
        with self._lock:
            self._changes += 1
            self._known = {}

    def get(self, id: str, kind: Literal["device", "key"]) -> Holder:
        """The device or key; NotFoundError if there is none."""
        with self._database.read() as connection:
            row = connection.execute(
                sa.select(principals).where(principals.c.id == id, principals.c.kind == kind)
            ).first()
        if row is None:
            raise NotFoundError(f"there is no {kind} '{id}'")
        return _holder(row)

    def list(
        self, kind: Literal["device", "key"], limit: int, after: int = 0, between: Between = ANY_TIME
    ) -> Page[Holder]:
        """Newest first."""
        query = sa.select(principals).where(principals.c.kind == kind)
        query = between.narrowed(query, principals.c.created, principals.c.name)
        with self._database.read() as connection:
            rows, cursor = page(connection, query, principals.c.number, limit, after)
        return Page(tuple(_holder(row) for row in rows), cursor)

    def remove(self, id: str, kind: Literal["device", "key"]) -> None:
        """Its token is worth nothing from now on.

        Raises
        ------
        NotFoundError
            If there is none.
        ConflictError
            If it is the last admin of all machines: nobody could pair another one.
        """
        holder = self.get(id, kind)
        with self._database.write("access") as connection:
            unbound = holder.role == "admin" and holder.machines is None and self._valid(holder) is not None
            if unbound and self._admins(connection) == 1:
                raise ConflictError(
                    f"{kind} '{id}' is the last admin; pair another one before removing it", "last_admin"
                )
            connection.execute(principals.delete().where(principals.c.id == id))
        self._forget()
        self._removed(id)

    def has_admin(self) -> bool:
        """Whether anybody can pair others."""
        with self._database.read() as connection:
            return self._admins(connection) > 0

    def _admins(self, connection: sa.Connection) -> int:
        valid = sa.or_(principals.c.expires.is_(None), principals.c.expires > self._database.now())
        query = sa.select(sa.func.count()).where(principals.c.role == "admin", principals.c.machines.is_(None), valid)
        return int(connection.execute(query).scalar_one())


def later(moment: str, by: timedelta) -> str:
    """A time of the store, so much later."""
    return (datetime.fromisoformat(moment) + by).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


def _holder(row: sa.Row[tuple[object, ...]]) -> Holder:
    values = {key: value for key, value in row._mapping.items() if key not in ("number", "secret_sha256")}
    values["machines"] = None if values["machines"] is None else tuple(values["machines"])
    return Holder(**values)
