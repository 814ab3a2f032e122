"""Ask for an identification: which recordings in which roles, checked before a job is made of it."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from daq import ROLES
from server.identifications.identification_store import Identification, Identifications
from server.jobs.job_store import Jobs
from server.machines.machine_store import Machines
from server.platform.database.engine import Database
from server.platform.database.idempotency import IdempotencyKey
from server.platform.errors import InvalidError
from server.recordings.recording_store import Recordings

#: Roles of which one has to be there: to fit, and to judge the fit by. Normal operation may stand for both.
NEEDED = (("train", "operation"), ("validate", "operation"))


@dataclass(frozen=True)
class Wish:
    """What a client asks for; ``recordings`` are (id, role or None for the role that it was recorded in)."""

    machine: str
    recordings: tuple[tuple[str, str | None], ...]
    options: dict[str, Any]
    label: str


class IdentificationOrders:
    """Takes orders: stores each identification with its job, and queues that.

    Parameters
    ----------
    stages : of an identification; asked for when one is ordered
    enqueue : queues a stored job
    """

    def __init__(
        self,
        database: Database,
        stages: Callable[[], tuple[str, ...]],
        enqueue: Callable[[str], None],
    ) -> None:
        self._database = database
        self._stages = stages
        self._enqueue = enqueue

    def order(self, wish: Wish, key: str | None) -> Identification:
        """Check a wish, store the identification and queue its job.

        Parameters
        ----------
        key : ``Idempotency-Key`` of the request; the same key with the same wish returns what was made the first
            time

        Raises
        ------
        NotFoundError, InvalidError, ConflictError, UnavailableError
            One line: what is wrong and what to do.
        """
        identification = self._stored(wish, key)
        self._enqueue(identification.job)
        return identification

    def _stored(self, wish: Wish, key: str | None) -> Identification:
        database = self._database
        machine = Machines(database).get(wish.machine)
        identification = Identification(
            id=f"idn-{secrets.token_hex(8)}",
            job=f"job-{secrets.token_hex(8)}",
            machine=machine.name,
            machine_version=machine.version,
            label=wish.label or f"Identification of {machine.name}",
            recordings=_chosen(database, wish),
            options=wish.options,
            created=database.now(),
        )
        content = [wish.machine, [list(entry) for entry in wish.recordings], wish.options, wish.label]
        known = IdempotencyKey.of(key, *content)
        return Jobs(database).order(Identifications(database), identification, "identification", self._stages(), known)


def _chosen(database: Database, wish: Wish) -> tuple[tuple[str, str], ...]:
    recordings = Recordings(database)
    chosen: dict[str, str] = {}
    for id, wanted in wish.recordings:
        row = recordings.get(id)
        role = wanted or row.role
        if role not in ROLES:
            raise InvalidError(f"recording '{id}': role '{role}' is unknown; use one of {', '.join(ROLES)}")
        if id in chosen:
            raise InvalidError(f"recording '{id}' is there twice; give each recording once")
        if row.machine != wish.machine:
            raise InvalidError(f"recording '{id}' is of machine '{row.machine}', not of '{wish.machine}'")
        if row.state != "sealed":
            raise InvalidError(f"recording '{id}' is {row.state}; only a sealed recording can be used")
        chosen[id] = role
    for role, instead in NEEDED:
        if not {role, instead} & set(chosen.values()):
            raise InvalidError(f"there is no recording in the role '{role}'; record one and give its id")
    return tuple(chosen.items())
