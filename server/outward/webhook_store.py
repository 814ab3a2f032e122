"""Webhooks and their deliveries in the store."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Unpack

import sqlalchemy as sa

from server.outward.outward_message import Message
from server.outward.webhook_tables import webhook_deliveries, webhooks
from server.platform.database.engine import Database, Page
from server.platform.database.lists import ANY_TIME, Between, Narrowing, listed
from server.platform.errors import NotFoundError

State = Literal["pending", "delivered", "given_up"]
#: Delivered ones that are kept of each webhook; what was given up stays until its webhook is removed.
KEPT = 500


@dataclass(frozen=True)
class Webhook:
    """Where messages of some types are delivered to."""

    id: str
    label: str
    url: str
    events: tuple[str, ...]
    secret_sha256: str
    created: str
    created_by: str


@dataclass(frozen=True)
class Delivery:
    """One message on its way to one webhook; ``error``: of the last try."""

    id: str
    webhook: str
    message: str
    type: str
    body: str
    state: State
    tries: int
    error: str | None
    created: str
    ended: str | None


class WebhookStore:
    """Repository of webhooks and deliveries."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, new: Webhook) -> None:
        """Store a new one."""
        with self._database.write("webhooks") as connection:
            connection.execute(webhooks.insert().values(**{**new.__dict__, "events": list(new.events)}))

    def get(self, id: str) -> Webhook:
        """The webhook; NotFoundError if there is none."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(webhooks).where(webhooks.c.id == id)).first()
        if row is None:
            raise NotFoundError(f"there is no webhook '{id}'")
        return _webhook(row)

    def list(self, limit: int, after: int = 0, between: Between = ANY_TIME) -> Page[Webhook]:
        """Newest first."""
        return listed(self._database, webhooks, _webhook, limit, after, between=between)

    def remove(self, id: str) -> None:
        """Forget one and its deliveries; NotFoundError if there is none."""
        self.get(id)
        with self._database.write("webhooks", "webhook_deliveries") as connection:
            connection.execute(webhook_deliveries.delete().where(webhook_deliveries.c.webhook == id))
            connection.execute(webhooks.delete().where(webhooks.c.id == id))

    def order(self, connection: sa.Connection, messages: Sequence[Message]) -> tuple[str, ...]:
        """Store the deliveries of messages to all webhooks that want them, in the transaction of ``connection``."""
        known = [_webhook(row) for row in connection.execute(sa.select(webhooks))]
        wanted = [(own, message) for message in messages for own in known if message.type in own.events]
        return tuple(self._order(connection, own.id, message) for own, message in wanted)

    def order_one(self, webhook: str, message: Message) -> str:
        """Store the delivery of a message to one webhook."""
        with self._database.write("webhook_deliveries") as connection:
            return self._order(connection, webhook, message)

    def _order(self, connection: sa.Connection, webhook: str, message: Message) -> str:
        values = {
            "id": f"dlv-{secrets.token_hex(8)}",
            "webhook": webhook,
            "message": message.id,
            "type": message.type,
            "body": message.body().decode(),
            "state": "pending",
            "tries": 0,
            "created": self._database.now(),
        }
        connection.execute(webhook_deliveries.insert().values(**values))
        return str(values["id"])

    def delivery(self, id: str) -> Delivery | None:
        """The delivery; None if its webhook was removed."""
        with self._database.read() as connection:
            row = connection.execute(sa.select(webhook_deliveries).where(webhook_deliveries.c.id == id)).first()
        return None if row is None else _delivery(row)

    def deliveries(self, limit: int, after: int = 0, **narrowed: Unpack[Narrowing]) -> Page[Delivery]:
        """Newest first."""
        return listed(self._database, webhook_deliveries, _delivery, limit, after, **narrowed)

    def pending(self) -> tuple[Delivery, ...]:
        """All that are on their way, oldest first."""
        query = sa.select(webhook_deliveries).where(webhook_deliveries.c.state == "pending")
        with self._database.read() as connection:
            return tuple(_delivery(row) for row in connection.execute(query.order_by(webhook_deliveries.c.number)))

    def tried(self, delivery: Delivery, number: int, error: str | None, state: State) -> None:
        """Store what became of try ``number``; old deliveries that arrived are forgotten."""
        ended = None if state == "pending" else self._database.now()
        table = webhook_deliveries.c
        old = (
            sa.select(table.number)
            .where(table.webhook == delivery.webhook, table.state == "delivered")
            .order_by(table.number.desc())
            .offset(KEPT)
            .limit(1)
            .scalar_subquery()
        )
        with self._database.write("webhook_deliveries") as connection:
            connection.execute(
                webhook_deliveries.update()
                .where(table.id == delivery.id)
                .values(tries=number, error=error, state=state, ended=ended)
            )
            connection.execute(
                webhook_deliveries.delete().where(
                    table.webhook == delivery.webhook, table.state == "delivered", table.number <= old
                )
            )

    def failing(self) -> tuple[Webhook, ...]:
        """Those whose last delivery that ended was given up, by label."""
        table = webhook_deliveries.c
        last = (
            sa.select(table.state)
            .where(table.webhook == webhooks.c.id, table.ended.is_not(None))
            .order_by(table.ended.desc(), table.number.desc())
            .limit(1)
            .correlate(webhooks)
            .scalar_subquery()
        )
        with self._database.read() as connection:
            rows = connection.execute(sa.select(webhooks).where(last == "given_up").order_by(webhooks.c.label))
            return tuple(_webhook(row) for row in rows)


def _webhook(row: sa.Row[Any]) -> Webhook:
    values = {key: value for key, value in row._mapping.items() if key != "number"}
    return Webhook(**{**values, "events": tuple(values["events"])})


def _delivery(row: sa.Row[Any]) -> Delivery:
    return Delivery(**{key: value for key, value in row._mapping.items() if key != "number"})
