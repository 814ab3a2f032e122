"""Alarms in the store."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Unpack

import sqlalchemy as sa

from server.alarms.alarm_lifecycle import Alarm
from server.alarms.alarm_tables import alarms
from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing, listed
from server.platform.database.outbox import put_out
from server.platform.errors import NotFoundError


class AlarmStore:
    """Repository of alarms; every change is a transaction and one revision of ``alarms``."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, id: str) -> Alarm:
        """The alarm; NotFoundError if there is none."""
        with self._database.read() as connection:
            return _get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Alarm]:
        """Newest first; ``machines``: only those of these machines, without those of the service as a whole."""
        return listed(self._database, alarms, _alarm, limit, after, **narrowed)

    def shelved(self) -> tuple[Alarm, ...]:
        """All that are on a shelf."""
        with self._database.read() as connection:
            return tuple(_alarm(row) for row in connection.execute(_select(alarms.c.shelved_until.is_not(None))))

    def active(self) -> tuple[Alarm, ...]:
        """All that are active."""
        with self._database.read() as connection:
            return tuple(_alarm(row) for row in connection.execute(_select(alarms.c.state == "active")))

    def open(self) -> tuple[Alarm, ...]:
        """All that are active, or that nobody acknowledged."""
        with self._database.read() as connection:
            condition = sa.or_(alarms.c.state == "active", alarms.c.acknowledged.is_(False))
            return tuple(_alarm(row) for row in connection.execute(_select(condition)))

    def since(self, machine: str, since: str, limit: int) -> tuple[Alarm, ...]:
        """Those of a machine that came, or went, at ``since`` (ISO 8601, UTC) or later, or are active; newest first."""
        later = sa.or_(alarms.c.raised >= since, alarms.c.cleared >= since, alarms.c.state == "active")
        query = sa.select(alarms).where(alarms.c.machine == machine, later)
        with self._database.read() as connection:
            rows = connection.execute(query.order_by(alarms.c.number.desc()).limit(limit))
            return tuple(_alarm(row) for row in rows)

    def change(self, id: str, to: Callable[[Alarm], Alarm]) -> Alarm:
        """Put ``to(alarm)`` in the place of the alarm; NotFoundError if there is none."""
        with self._database.read() as connection:
            if to(_get(connection, id)) == _get(connection, id):
                return _get(connection, id)
        with self._database.write("alarms") as connection:
            changed = to(_get(connection, id))
            connection.execute(alarms.update().where(alarms.c.id == id).values(**changed.__dict__))
            put_out(connection, "alarm", self._database.now(), changed.__dict__)
        return changed

    def set(self, machine: str | None, kind: str, to: Callable[[Alarm | None], Alarm | None]) -> Alarm | None:
        """Put ``to(newest)`` in the place of the newest alarm of that machine and kind, or beside it if its id is new.

        Nothing is written where nothing changes.
        """
        with self._database.read() as connection:
            last = _newest(connection, machine, kind)
        if to(last) == last:
            return last
        with self._database.write("alarms") as connection:
            last = _newest(connection, machine, kind)
            wanted = to(last)
            if wanted is not None and (last is None or wanted.id != last.id):
                connection.execute(alarms.insert().values(**wanted.__dict__))
            elif wanted is not None:
                connection.execute(alarms.update().where(alarms.c.id == wanted.id).values(**wanted.__dict__))
            if wanted is not None:
                put_out(connection, "alarm", self._database.now(), wanted.__dict__)
        return wanted


def _select(condition: sa.ColumnElement[bool]) -> sa.Select[Any]:
    return sa.select(alarms).where(condition).order_by(alarms.c.number)


def _get(connection: sa.Connection, id: str) -> Alarm:
    row = connection.execute(sa.select(alarms).where(alarms.c.id == id)).first()
    if row is None:
        raise NotFoundError(f"there is no alarm '{id}'")
    return _alarm(row)


def _newest(connection: sa.Connection, machine: str | None, kind: str) -> Alarm | None:
    query = sa.select(alarms).where(alarms.c.kind == kind, alarms.c.machine.is_not_distinct_from(machine))
    row = connection.execute(query.order_by(alarms.c.number.desc()).limit(1)).first()
    return None if row is None else _alarm(row)


def _alarm(row: sa.Row[Any]) -> Alarm:
    return Alarm(**{key: value for key, value in row._mapping.items() if key != "number"})
