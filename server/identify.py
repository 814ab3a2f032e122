"""Ask for an identification: which recordings in which roles, checked before a job is made of it."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from typing import Any

from daq import ROLES
from server.errors import InvalidError
from server.store import Database, Identification, Identifications, Jobs, Machines, Recordings
from server.store.idempotency import IdempotencyKey

#: Roles of which one has to be there: to fit, and to judge the fit by. Normal operation may stand for both.
NEEDED = (("train", "operation"), ("validate", "operation"))


@dataclass(frozen=True)
class Wish:
    """What a client asks for; ``recordings`` are (id, role or None for the role that it was recorded in)."""

    machine: str
    recordings: tuple[tuple[str, str | None], ...]
    options: dict[str, Any]
    label: str


def order_identification(
    database: Database, wish: Wish, stages: tuple[str, ...], key: str | None = None
) -> Identification:
    """Check a wish and store the identification with its queued job.

    Parameters
    ----------
    key : ``Idempotency-Key`` of the request; the same key with the same wish returns what was made the first
        time

    Raises
    ------
    NotFoundError, InvalidError, ConflictError
        One line: what is wrong and what to do.
    """
    machine = Machines(database).get(wish.machine)
    chosen = _chosen(database, wish)
    jobs = Jobs(database)
    identification = Identification(
        id=f"idn-{secrets.token_hex(8)}",
        job=f"job-{secrets.token_hex(8)}",
        machine=machine.name,
        machine_version=machine.version,
        label=wish.label or f"Identification of {machine.name}",
        recordings=chosen,
        options=wish.options,
        created=database.now(),
    )
    content = [wish.machine, [list(entry) for entry in wish.recordings], wish.options, wish.label]
    idempotency = IdempotencyKey.of(key, *content)
    return Identifications(database).add(
        identification,
        lambda connection: jobs.insert(
            connection,
            id=identification.job,
            kind="identification",
            label=identification.label,
            subject=identification.id,
            stages=stages,
        ),
        idempotency,
    )


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
