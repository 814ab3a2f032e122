"""Ask for something to be identified: which recordings in which roles, checked before a job is made of it."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Generic

from daq import ROLES
from server.identifications.identification_store import Fits, Identification, Identifications, Ordered
from server.jobs.job_store import Jobs
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey
from server.platform.errors import InvalidError
from server.recordings.recording_store import Recordings


@dataclass(frozen=True)
class Wish:
    """Wish of a client; ``recordings`` are (id, role or None for the role that it was recorded in)."""

    machine: str
    recordings: tuple[tuple[str, str | None], ...]
    options: dict[str, Any]
    label: str


@dataclass(frozen=True)
class Orders(Generic[Ordered]):
    """Takes orders of one kind: stores each with its job, and queues that.

    Attributes
    ----------
    stages : of such a job; asked for when one is ordered
    enqueue : queues a stored job
    fits : where they are stored
    prefix : of their ids
    label : of one to which nobody gave a label; ``{}`` is the machine
    needed : roles of which one has to be there
    kind : what distinguishes such an order from those of other kinds with the same content, under one key
    """

    fits: ClassVar[type[Fits[Any]]]
    prefix: ClassVar[str]
    label: ClassVar[str]
    needed: ClassVar[tuple[tuple[str, ...], ...]]
    kind: ClassVar[tuple[str, ...]]
    database: Database
    stages: Callable[[], tuple[str, ...]]
    enqueue: Callable[[str], None]

    def order(self, wish: Wish, key: str | None) -> Ordered:
        """Check a wish, store it and queue its job.

        Parameters
        ----------
        key : ``Idempotency-Key`` of the request; the same key with the same wish returns what was made the first
            time

        Raises
        ------
        NotFoundError, InvalidError, ConflictError, UnavailableError
            One line: what is wrong and what to do.
        """
        stored = self._stored(wish, key)
        self.enqueue(stored.job)
        return stored

    def _stored(self, wish: Wish, key: str | None) -> Ordered:
        database = self.database
        machine = Machines(database).get(wish.machine)
        new: Ordered = self.fits.of(
            id=f"{self.prefix}-{secrets.token_hex(8)}",
            job=f"job-{secrets.token_hex(8)}",
            machine=machine.name,
            machine_version=machine.version,
            label=wish.label or self.label.format(machine.name),
            recordings=_chosen(database, wish, self.needed),
            options=wish.options,
            created=database.now(),
        )
        content = [*self.kind, wish.machine, [list(own) for own in wish.recordings], wish.options, wish.label]
        fits: Fits[Ordered] = self.fits(database)
        known = IdempotencyKey.of(key, *content)
        return Jobs(database).order(fits, new, fits.one, self.stages(), known)


class IdentificationOrders(Orders[Identification]):
    """Orders of identifications: something to fit, and something to judge the fit by. Normal operation may be both."""

    fits, prefix, label, kind = Identifications, "idn", "Identification of {}", ()
    needed = (("train", "operation"), ("validate", "operation"))


def _chosen(database: Database, wish: Wish, needed: tuple[tuple[str, ...], ...]) -> tuple[tuple[str, str], ...]:
    recordings = Recordings(database)
    chosen: dict[str, str] = {}
    for id, wanted in wish.recordings:
        row = recordings.get(id)
        role = wanted or row.role
        if role not in ROLES:
            raise InvalidError("server.recording_role_unknown", id=id, role=role, roles=", ".join(ROLES))
        if id in chosen:
            raise InvalidError("server.recording_twice", id=id)
        if row.machine != wish.machine:
            raise InvalidError("server.recording_machine_not", id=id, machine=row.machine, machine_2=wish.machine)
        if row.state != "sealed":
            raise InvalidError("server.recording_not_sealed", id=id, state=row.state)
        chosen[id] = role
    for roles in needed:
        if not set(roles) & set(chosen.values()):
            raise InvalidError("server.no_recording_role", role=roles[0])
    return tuple(chosen.items())
