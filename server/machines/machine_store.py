"""Machines and the versions of their files."""

from __future__ import annotations

from typing import Annotated, Any

import sqlalchemy as sa

from server.platform.database.repository import Repository
from server.platform.database.schema import metadata
from server.platform.database.stored import BESIDE, Kept, Stored
from server.platform.errors import ConflictError, NotFoundError


class MachineRow(Stored, table="machine_versions", label="name", machine="name"):
    """One version of a machine; ``acquire`` and ``current`` (the newest version) are the machine's."""

    name: Annotated[str, Kept(references="machines.name", key=True)]
    version: Annotated[int, Kept(key=True)]
    current: Annotated[int, BESIDE]
    sha256: str
    created: str
    acquire: Annotated[bool, BESIDE]


machine_versions = MachineRow.table
machines = sa.Table(
    "machines",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),  # order of creation: the cursor of pages
    sa.Column("name", sa.String, nullable=False, unique=True),
    sa.Column("version", sa.Integer, nullable=False),  # the current one
    sa.Column("acquire", sa.Boolean, nullable=False),  # whether acquisition should run
)


class Machines(Repository[MachineRow]):
    """Repository of machines; those that are listed are current versions, the machine added last first."""

    of = MachineRow

    def selected(self) -> sa.Select[Any]:
        """Select the current versions."""
        return _versions().where(_is_current())

    def next_version(self, name: str, sha256: str) -> int | None:
        """Return the version that a file with this hash would get; None if it is the current one already.

        ConflictError if there is none of this name, and one that differs from it by capitals alone.
        """
        with self._database.read() as connection:
            row = connection.execute(_versions().where(machines.c.name == name, _is_current())).first()
            alike = sa.select(machines.c.name).where(sa.func.lower(machines.c.name) == name.lower())
            other = None if row is not None else connection.execute(alike).scalar()
        if other is not None:
            raise ConflictError("server.machine_already_reads_like", other=other, name=name)
        if row is None:
            return 1
        return None if row.sha256 == sha256 else int(row.version) + 1

    def add(self, name: str, version: int, sha256: str, *, acquire: bool = False) -> None:
        """Store a version and make it the current one; ``acquire`` counts for a new machine only."""
        with self._database.write("machines") as connection:
            if version == 1:
                connection.execute(machines.insert().values(name=name, version=1, acquire=acquire))
            else:
                connection.execute(machines.update().where(machines.c.name == name).values(version=version))
            connection.execute(
                machine_versions.insert().values(
                    name=name, version=version, sha256=sha256, created=self._database.now()
                )
            )

    def get(self, name: str, version: int | None = None) -> MachineRow:
        """Return one version, by default the current one.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        wanted = _is_current() if version is None else machine_versions.c.version == version
        with self._database.read() as connection:
            row = connection.execute(_versions().where(machines.c.name == name, wanted)).first()
        if row is None:
            if version is None:
                raise NotFoundError("server.no_machine_file", machine=name).about(machine=name)
            raise NotFoundError("server.no_machine_version", version=version, machine=name).about(machine=name)
        return MachineRow.read(row)

    def versions(self, name: str) -> tuple[MachineRow, ...]:
        """List every version of a machine, newest first; empty if there is no such machine."""
        query = _versions().where(machines.c.name == name).order_by(machine_versions.c.version.desc())
        with self._database.read() as connection:
            return self.values(connection, connection.execute(query).all())

    def acquiring(self) -> tuple[MachineRow, ...]:
        """List the machines whose acquisition should run."""
        return self.all(machines.c.acquire)

    def set_acquire(self, name: str, acquire: bool) -> None:
        """Store whether acquisition should run (now and after a restart)."""
        with self._database.write("machines") as connection:
            connection.execute(machines.update().where(machines.c.name == name).values(acquire=acquire))


def _is_current() -> sa.ColumnElement[bool]:
    return machine_versions.c.version == machines.c.version


def _versions() -> sa.Select[Any]:
    joined = machines.join(machine_versions, machines.c.name == machine_versions.c.name)
    return sa.select(
        machines.c.number,
        machine_versions,
        machines.c.acquire,
        machines.c.version.label("current"),
    ).select_from(joined)
