"""Calibrations in the store.

::

    proposed ──approve──► approved ──activate──► active ──another one──► retired ──activate, roll back──► active
        └──────reject──────┴──► rejected             │
                                 retired ◄─deactivate─┘
"""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import sqlalchemy as sa

from server.calibrations.calibration_content import Content, Parameter
from server.identifications.identification_store import Fit
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database
from server.platform.database.repository import Repository
from server.platform.database.schema import metadata
from server.platform.database.stored import BESIDE, HIDDEN, Id, Kept, OfMachine, Revision, Stored
from server.platform.errors import ConflictError, PreconditionError
from server.platform.http.route_parameters import Tags

#: Notes of steps that undo an activation, by which a page can tell what rolling back leads to.
ROLLED_BACK, OUT_OF_USE = "rolled back to", "taken out of use"
State = Literal["proposed", "approved", "rejected", "active", "retired"]
#: What a calibration is of, and the column that says which: the arm's mechanics or its valves. One of each is in use.
Of = Literal["identification", "valves"]


class StepResource(Stored, table="calibration_steps"):
    """Who did what to a calibration, when."""

    calibration: Annotated[str, Kept(references="calibrations.id", index=True), HIDDEN]
    time: str
    action: Literal["proposed", "approved", "rejected", "activated", "retired"]
    by: str
    by_id: Annotated[str, HIDDEN]
    note: str


class Calibration(Stored, table="calibrations", noun="calibration"):
    """One calibration, of an identification or of valves.

    ``revision`` counts its changes, ``history`` has them, oldest first.
    """

    id: Id
    revision: Revision
    machine: OfMachine
    identification: Annotated[str | None, Kept(references="identifications.id", unique=True)] = None
    valves: Annotated[str | None, Kept(unique=True)] = None
    label: str
    state: State
    proposed_by: str
    proposed_by_id: str
    approved_by: str | None = None
    created: str
    activated: str | None = None
    verdict: str
    overall: dict[str, Any]
    errors: dict[str, Any]
    parameters: list[Parameter]
    model: Annotated[dict[str, Any], HIDDEN]
    note: str
    history: Annotated[tuple[StepResource, ...], BESIDE] = ()

    @property
    def kind(self) -> Of:
        """Kind of fit that it is of."""
        return "valves" if self.identification is None else "identification"

    @property
    def source(self) -> str:
        """Id of that fit."""
        return str(self.identification or self.valves)


calibrations, calibration_steps = Calibration.table, StepResource.table
#: Which calibration was in use when; the last one per machine that is not undone is active.
activations = sa.Table(
    "calibration_activations",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("machine", sa.String, sa.ForeignKey("machines.name"), nullable=False, index=True),
    sa.Column("calibration", sa.String, sa.ForeignKey("calibrations.id"), nullable=False),
    sa.Column("time", sa.String, nullable=False),
    sa.Column("undone", sa.Boolean, nullable=False),
)


class CalibrationStore(Repository[Calibration]):
    """Repository of calibrations; every change is a transaction and one revision of ``calibrations``.

    Parameters
    ----------
    approves_own : whether whoever proposed a calibration may approve it
    """

    of = Calibration

    def __init__(self, database: Database, approves_own: bool = True) -> None:
        super().__init__(database)
        self._approves_own = approves_own

    def add(
        self, source: Fit, label: str, content: Content, by: Principal, of: Of = "identification"
    ) -> tuple[Calibration, bool]:
        """Propose; the one that is there already, and False, if this was proposed before."""
        with self._database.write("calibrations") as connection:
            known = sa.select(calibrations).where(calibrations.c[of] == source.id)
            if rows := connection.execute(known).all():
                return self.values(connection, rows)[0], False
            new = Calibration(
                id=f"cal-{secrets.token_hex(8)}",
                revision=1,
                machine=source.machine,
                label=label or source.label,
                state="proposed",
                proposed_by=by.name,
                proposed_by_id=by.id,
                note="",
                created=self._database.now(),
                **content.__dict__,
            ).but(**{of: source.id})
            self.put(connection, new)
            self._step(connection, new.id, "proposed", by, "")
            return self.found(connection, new.id), True

    def active(self, machine: str, of: Of = "identification") -> Calibration | None:
        """Return the one in use; None if the machine has none."""
        found = self.all(*_in_use(machine, of))
        return found[0] if found else None

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
            found = self._expected(connection, id, revisions)
            if found.state != "proposed" and not (found.state == "approved" and state == "rejected"):
                refusal = ConflictError("server.calibration_not_proposed", id=id, state=found.state, state_2=state)
                raise refusal.about(**_is(found))
            own = found.proposed_by_id == by.id and by.kind != "service"
            if state == "approved" and own and not self._approves_own:
                raise ConflictError("server.calibration_proposed_you", id=id).about("second_person", calibration=id)
            approved_by = by.name if state == "approved" else found.approved_by
            self._changed(connection, found, state=state, note=note, approved_by=approved_by)
            self._step(connection, id, state, by, note)
            return self.found(connection, id)

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
            found = self._expected(connection, id, revisions)
            if found.state == "active":
                return found
            if found.state not in ("approved", "retired"):
                raise ConflictError("server.calibration_not_approved", id=id, state=found.state).about(**_is(found))
            now = self._database.now()
            connection.execute(
                activations.insert().values(machine=found.machine, calibration=id, time=now, undone=False)
            )
            self._put_in_use(connection, found, now, by, "")
            return self.found(connection, id)

    def roll_back(self, machine: str, by: Principal, of: Of = "identification") -> Calibration:
        """Use the one again that was in use before the active one; ConflictError if there was none."""
        with self._database.write("calibrations") as connection:
            lasting = self._lasting(connection, machine, of)
            if len(lasting) < 2 or self.found(connection, lasting[0].calibration).state != "active":
                raise ConflictError("server.machine_had_no_other", machine=machine).about("no_calibration_before")
            current, before = lasting
            connection.execute(activations.update().where(activations.c.number == current.number).values(undone=True))
            again = self.found(connection, before.calibration)
            self._put_in_use(connection, again, self._database.now(), by, ROLLED_BACK)
            return self.found(connection, before.calibration)

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
            found = self._expected(connection, id, revisions)
            if found.state != "active":
                raise ConflictError("server.calibration_not_in_use", id=id, state=found.state).about(**_is(found))
            newest = self._lasting(connection, found.machine, found.kind)[0]
            connection.execute(activations.update().where(activations.c.number == newest.number).values(undone=True))
            self._changed(connection, found, state="retired")
            self._step(connection, id, "retired", by, f"{OUT_OF_USE}: {note}" if note else OUT_OF_USE)
            return self.found(connection, id)

    def _lasting(self, connection: sa.Connection, machine: str, of: Of) -> list[Any]:
        query = sa.select(activations).where(activations.c.machine == machine, sa.not_(activations.c.undone))
        own = sa.select(calibrations.c.id).where(calibrations.c[of].is_not(None))
        query = query.where(activations.c.calibration.in_(own))
        return list(connection.execute(query.order_by(activations.c.number.desc()).limit(2)))

    def _put_in_use(self, connection: sa.Connection, found: Calibration, now: str, by: Principal, note: str) -> None:
        in_use = sa.select(calibrations).where(*_in_use(found.machine, found.kind))
        for other in self.values(connection, connection.execute(in_use).all()):
            self._changed(connection, other, state="retired")
            self._step(connection, other.id, "retired", by, "")
        self._changed(connection, found, state="active", activated=now)
        self._step(connection, found.id, "activated", by, note)

    def _step(self, connection: sa.Connection, id: str, action: str, by: Principal, note: str) -> None:
        values = {"calibration": id, "time": self._database.now(), "action": action}
        connection.execute(calibration_steps.insert().values(**values, by=by.name, by_id=by.id, note=note))

    def _expected(self, connection: sa.Connection, id: str, revisions: Tags) -> Calibration:
        found = self.found(connection, id)
        if revisions is not None and str(found.revision) not in revisions:
            raise PreconditionError("server.calibration_changed_since_you", id=id).about(calibration=id)
        return found

    def _changed(self, connection: sa.Connection, found: Calibration, **values: Any) -> None:
        self.update(connection, found.id, **values, revision=found.revision + 1)

    def values(self, connection: sa.Connection, rows: Sequence[sa.Row[Any]]) -> tuple[Calibration, ...]:
        """Return what rows hold, each with what was done to it."""
        steps: dict[str, list[StepResource]] = {row.id: [] for row in rows}
        query = sa.select(calibration_steps).where(calibration_steps.c.calibration.in_(steps))
        for step in connection.execute(query.order_by(calibration_steps.c.number)):
            steps[step.calibration].append(StepResource.read(step))
        return tuple(Calibration.read(row, history=steps[row.id]) for row in rows)


def _in_use(machine: str, of: Of) -> tuple[sa.ColumnElement[bool], ...]:
    return calibrations.c.machine == machine, calibrations.c.state == "active", calibrations.c[of].is_not(None)


def _is(found: Calibration) -> dict[str, str]:
    """Return a refusal's extension for programs: the state that forbids something."""
    return {"code": f"calibration_is_{found.state}", "calibration": found.id}
