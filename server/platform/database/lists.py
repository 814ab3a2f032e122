"""Pages of a table, newest first, narrowed to what whoever asks wants and may see."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypedDict, TypeVar, Unpack

import sqlalchemy as sa

from server.platform.database.engine import Database, Page, as_stored, page

Item = TypeVar("Item")


@dataclass(frozen=True)
class Between:
    """Of a list: what was made from ``since`` on and before ``until``, and whose label has ``labelled`` in it."""

    since: datetime | None = None
    until: datetime | None = None
    labelled: str = ""

    def narrowed(self, query: sa.Select[Any], created: sa.Column[str], label: sa.Column[str]) -> sa.Select[Any]:
        """The query of these; times are stored as text that sorts."""
        if self.since is not None:
            query = query.where(created >= as_stored(self.since))
        if self.until is not None:
            query = query.where(created < as_stored(self.until))
        return query.where(label.icontains(self.labelled, autoescape=True)) if self.labelled else query


ANY_TIME = Between()


class Narrowing(TypedDict, total=False):
    """What narrows a list; None narrows nothing.

    ``machine``, ``role``, ``state`` and ``webhook`` are those of a row, ``machines`` those that whoever asks may see.
    """

    machine: str | None
    machines: tuple[str, ...] | None
    role: str | None
    state: str | None
    webhook: str | None
    between: Between


def rows_of(
    connection: sa.Connection, table: sa.Table, limit: int, after: int, **narrowed: Unpack[Narrowing]
) -> tuple[Sequence[sa.Row[Any]], int | None]:
    """Rows of a table with a ``number``, newest first, and the cursor of the next page.

    What counts as time and label of a row are the columns that ``table.info`` says, else ``created`` and ``label``.
    """
    created, label = (table.c[table.info.get(name, name)] for name in ("created", "label"))
    query = narrowed.get("between", ANY_TIME).narrowed(sa.select(table), created, label)
    if (seen := narrowed.get("machines")) is not None:
        query = query.where(table.c.machine.in_(seen))
    for name in ("machine", "role", "state", "webhook"):
        if (wanted := narrowed.get(name)) is not None:
            query = query.where(table.c[name] == wanted)
    return page(connection, query, table.c.number, limit, after)


def listed(
    database: Database,
    table: sa.Table,
    make: Callable[[sa.Row[Any]], Item],
    limit: int,
    after: int,
    **narrowed: Unpack[Narrowing],
) -> Page[Item]:
    """A page of what ``make`` makes of each row."""
    with database.read() as connection:
        rows, cursor = rows_of(connection, table, limit, after, **narrowed)
    return Page(tuple(make(row) for row in rows), cursor)
