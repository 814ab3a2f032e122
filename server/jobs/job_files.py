"""Which files of jobs a backup has to hold."""

from __future__ import annotations

import sqlalchemy as sa

from server.jobs.job_tables import jobs
from server.platform.resource import NamedFiles


def named_results(table: sa.Table, connection: sa.Connection) -> NamedFiles:
    """What a store names of the things in ``table`` that jobs make: the place that counts, and all below.

    Their directories are called like the table.
    """
    needed, others = set(), set()
    for id, place in connection.execute(sa.select(table.c.id, jobs.c.place).join(jobs, jobs.c.id == table.c.job)):
        others.add(f"{table.name}/{id}")
        if place is not None:
            needed.add(f"{table.name}/{id}/{place}")
    return NamedFiles(frozenset(needed), frozenset(others))
