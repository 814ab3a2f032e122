"""Calibrations in the store.

::

    proposed ──approve──► approved ──activate──► active ──another one──► retired ──activate, roll back──► active
        └──────reject──────┴──► rejected             │
                                 retired ◄─deactivate─┘
"""

from __future__ import annotations

import builtins
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Unpack

import sqlalchemy as sa

from server.calibrations.calibration_content import Content
from server.calibrations.calibration_tables import calibration_activations as activations
from server.calibrations.calibration_tables import calibration_steps, calibrations
from server.identifications.identification_store import Identification
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database, Page
from server.platform.database.lists import Narrowing, rows_of
from server.platform.errors import ConflictError, NotFoundError, PreconditionError
from server.platform.http.route_parameters import Tags

#: Notes of steps that undo an activation, by which a page can tell what rolling back leads to.
ROLLED_BACK, OUT_OF_USE = "rolled back to", "taken out of use"
State = Literal["proposed", "approved", "rejected", "active", "retired"]


@dataclass(frozen=True)
class Step:
    """Who did what to a calibration, when: ``proposed``, ``approved``, ``rejected``, ``activated``, ``retired``."""

    time: str
    action: str
    by: str
    note: str


@dataclass(frozen=True)
class Calibration:
    """One calibration; ``revision`` counts its changes, ``history`` has them, oldest first."""

    id: str
    revision: int
    machine: str
    identification: str
    label: str
    state: State
    proposed_by: str
    proposed_by_id: str
    note: str
    verdict: str
    overall: dict[str, Any]
    errors: dict[str, Any]
    parameters: list[dict[str, Any]]
    model: dict[str, Any]
    created: str
    approved_by: str | None = None
    activated: str | None = None
    history: tuple[Step, ...] = ()


class CalibrationStore:
    """Repository of calibrations; every change is a transaction and one revision of ``calibrations``.

    Parameters
    ----------
    approves_own : whether whoever proposed a calibration may approve it
    """

    def __init__(self, database: Database, approves_own: bool = True) -> None:
        self._database = database
        self._approves_own = approves_own

    def add(self, source: Identification, label: str, content: Content, by: Principal) -> tuple[Calibration, bool]:
        """Propose; the one that is there already, and False, if this identification was proposed before."""
        with self._database.write("calibrations") as connection:
            known = connection.execute(
                sa.select(calibrations).where(calibrations.c.identification == source.id)
            ).first()
            if known is not None:
                return _get(connection, known.id), False
            new = Calibration(
                id=f"cal-{secrets.token_hex(8)}",
                revision=1,
                machine=source.machine,
                identification=source.id,
                label=label or source.label,
                state="proposed",
                proposed_by=by.name,
                proposed_by_id=by.id,
                note="",
                created=self._database.now(),
                **content.__dict__,
            )
            row = {key: value for key, value in new.__dict__.items() if key != "history"}
            connection.execute(calibrations.insert().values(**row))
            self._step(connection, new.id, "proposed", by, "")
            return _get(connection, new.id), True

    def get(self, id: str) -> Calibration:
        """The calibration; NotFoundError if there is none."""
        with self._database.read() as connection:
            return _get(connection, id)

    def list(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Calibration]:
        """Newest first, narrowed to what is given."""
        with self._database.read() as connection:
            rows, cursor = rows_of(connection, calibrations, limit, after, **narrowed)
            return Page(_with_history(connection, rows), cursor)

    def active(self, machine: str) -> Calibration | None:
        """The one in use; None if the machine has none."""
        query = sa.select(calibrations).where(calibrations.c.machine == machine, calibrations.c.state == "active")
        with self._database.read() as connection:
            row = connection.execute(query).first()
            return None if row is None else _with_history(connection, [row])[0]

    def decide(
        self, id: str, state: Literal["approved", "rejected"], by: Principal, note: str, revisions: Tags
    ) -> Calibration:
        """Approve or reject.

        Raises
        ------
        ConflictError
            If its state forbids it, or ``by`` proposed it (or ordered the recalibration that did) and wants to approve
            it, and the policy forbids that. What schedules do by themselves has a policy of its own.
        PreconditionError
            If ``revisions`` are given and the current one is none of them.
        """
        with self._database.write("calibrations") as connection:
            found = _expect(connection, id, revisions)
            if found.state != "proposed" and not (found.state == "approved" and state == "rejected"):
                raise ConflictError(
                    f"calibration '{id}' is {found.state}; only a proposed one can be {state}", **_is(found)
                )
            own = found.proposed_by_id == by.id and by.kind != "service"
            if state == "approved" and own and not self._approves_own:
                text = f"calibration '{id}' was proposed by you; a second person has to approve it"
                raise ConflictError(text, "second_person", calibration=id)
            approved_by = by.name if state == "approved" else found.approved_by
            _update(connection, found, state=state, note=note, approved_by=approved_by)
            self._step(connection, id, state, by, note)
            return _get(connection, id)

    def activate(self, id: str, revisions: Tags, by: Principal) -> Calibration:
        """Use it in the name of ``by``; the one in use before is retired. Nothing happens if it is active.

        Raises
        ------
        ConflictError
            If nobody approved it.
        PreconditionError
            If ``revisions`` are given and the current one is none of them.
        """
        with self._database.write("calibrations") as connection:
            found = _expect(connection, id, revisions)
            if found.state == "active":
                return found
            if found.state not in ("approved", "retired"):
                raise ConflictError(
                    f"calibration '{id}' is {found.state}; it has to be approved before it is used", **_is(found)
                )
            now = self._database.now()
            connection.execute(
                activations.insert().values(machine=found.machine, calibration=id, time=now, undone=False)
            )
            self._put_in_use(connection, found, now, by, "")
            return _get(connection, id)

    def roll_back(self, machine: str, by: Principal) -> Calibration:
        """Use the one again that was in use before the active one; ConflictError if there was none."""
        with self._database.write("calibrations") as connection:
            lasting = self._lasting(connection, machine)
            if len(lasting) < 2 or _get(connection, lasting[0].calibration).state != "active":
                raise ConflictError(
                    f"machine '{machine}' had no other calibration in use before; activate one instead",
                    "no_calibration_before",
                )
            current, before = lasting
            connection.execute(activations.update().where(activations.c.number == current.number).values(undone=True))
            again = _get(connection, before.calibration)
            self._put_in_use(connection, again, self._database.now(), by, ROLLED_BACK)
            return _get(connection, before.calibration)

    def deactivate(self, id: str, revisions: Tags, by: Principal, note: str) -> Calibration:
        """Take it out of use in the name of ``by``: the machine has none in use then, as before its first one.

        Raises
        ------
        ConflictError
            If it is not in use.
        PreconditionError
            If ``revisions`` are given and the current one is none of them.
        """
        with self._database.write("calibrations") as connection:
            found = _expect(connection, id, revisions)
            if found.state != "active":
                raise ConflictError(
                    f"calibration '{id}' is {found.state}; only the one in use can be taken out of use", **_is(found)
                )
            newest = self._lasting(connection, found.machine)[0]
            connection.execute(activations.update().where(activations.c.number == newest.number).values(undone=True))
            _update(connection, found, state="retired")
            self._step(connection, id, "retired", by, f"{OUT_OF_USE}: {note}" if note else OUT_OF_USE)
            return _get(connection, id)

    def _lasting(self, connection: sa.Connection, machine: str) -> builtins.list[Any]:
        query = sa.select(activations).where(activations.c.machine == machine, sa.not_(activations.c.undone))
        return builtins.list(connection.execute(query.order_by(activations.c.number.desc()).limit(2)))

    def _put_in_use(self, connection: sa.Connection, found: Calibration, now: str, by: Principal, note: str) -> None:
        query = sa.select(calibrations).where(calibrations.c.machine == found.machine, calibrations.c.state == "active")
        for row in connection.execute(query).all():
            _update(connection, _calibration(row), state="retired")
            self._step(connection, row.id, "retired", by, "")
        _update(connection, found, state="active", activated=now)
        self._step(connection, found.id, "activated", by, note)

    def _step(self, connection: sa.Connection, id: str, action: str, by: Principal, note: str) -> None:
        values = {"calibration": id, "time": self._database.now(), "action": action}
        connection.execute(calibration_steps.insert().values(**values, by=by.name, by_id=by.id, note=note))


def _expect(connection: sa.Connection, id: str, revisions: Tags) -> Calibration:
    found = _get(connection, id)
    if revisions is not None and str(found.revision) not in revisions:
        raise PreconditionError(f"calibration '{id}' changed since you read it; read it again", calibration=id)
    return found


def _is(found: Calibration) -> dict[str, str]:
    """What a refusal says to programs: the state that forbids something."""
    return {"code": f"calibration_is_{found.state}", "calibration": found.id}


def _update(connection: sa.Connection, found: Calibration, **values: Any) -> None:
    connection.execute(
        calibrations.update().where(calibrations.c.id == found.id).values(**values, revision=found.revision + 1)
    )


def _get(connection: sa.Connection, id: str) -> Calibration:
    row = connection.execute(sa.select(calibrations).where(calibrations.c.id == id)).first()
    if row is None:
        raise NotFoundError(f"there is no calibration '{id}'", calibration=id)
    return _with_history(connection, [row])[0]


def _with_history(connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Calibration, ...]:
    """Calibrations, each with what was done to it."""
    steps: dict[str, builtins.list[Step]] = {row.id: [] for row in rows}
    query = sa.select(calibration_steps).where(calibration_steps.c.calibration.in_(steps))
    for step in connection.execute(query.order_by(calibration_steps.c.number)):
        steps[step.calibration].append(Step(step.time, step.action, step.by, step.note))
    return tuple(replace(_calibration(row), history=tuple(steps[row.id])) for row in rows)


def _calibration(row: sa.Row[Any]) -> Calibration:
    return Calibration(**{key: value for key, value in row._mapping.items() if key != "number"})
