"""Webhooks and their deliveries in the store."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from typing import Annotated, Literal

import sqlalchemy as sa

from server.outward.outward_message import Kind, Message
from server.platform.database.engine import Database
from server.platform.database.repository import Repository
from server.platform.database.stored import HIDDEN, Id, Kept, Stored
from server.platform.http import bodies

Event = Literal["alarm", "result"]
State = Literal["pending", "delivered", "given_up"]
#: Delivered ones that are kept of each webhook; what was given up stays until its webhook is removed.
KEPT = 500


class Webhook(Stored, table="webhooks", noun="webhook"):
    """An address that messages of some types are delivered to.

    ``secret_sha256`` shows whether this computer has its secret.
    """

    id: Id
    label: str
    url: str
    events: tuple[Event, ...]
    secret_sha256: Annotated[str, HIDDEN]
    created: str
    created_by: str


class Delivery(Stored, table="webhook_deliveries", label="type"):
    """One message on its way to one webhook; ``error``: of the last try."""

    id: Id
    webhook: Annotated[str, Kept(references="webhooks.id", ondelete="CASCADE", index=True), HIDDEN]
    message: str
    type: Kind
    body: Annotated[str, HIDDEN]  # what is signed and sent
    state: Annotated[State, Kept(index=True)] = "pending"
    tries: int = 0
    error: str | None = None
    error_message: bodies.Message | None = None
    created: str
    ended: str | None = None


webhooks, webhook_deliveries = Webhook.table, Delivery.table


class _Deliveries(Repository[Delivery]):
    """Repository of deliveries."""

    of = Delivery


class WebhookStore(Repository[Webhook]):
    """Repository of webhooks, with their deliveries."""

    of = Webhook

    def __init__(self, database: Database) -> None:
        super().__init__(database)
        self.deliveries = _Deliveries(database)

    def remove(self, id: str) -> None:
        """Forget one and its deliveries; NotFoundError if there is none."""
        self.get(id)
        with self._database.write("webhooks", "webhook_deliveries") as connection:
            connection.execute(webhook_deliveries.delete().where(webhook_deliveries.c.webhook == id))
            connection.execute(webhooks.delete().where(webhooks.c.id == id))

    def order(self, connection: sa.Connection, messages: Sequence[Message]) -> tuple[str, ...]:
        """Store the deliveries of messages to all webhooks that want them, in the transaction of ``connection``."""
        known = self.values(connection, connection.execute(sa.select(webhooks)).all())
        wanted = [(own, message) for message in messages for own in known if message.type in own.events]
        return tuple(self._order(connection, own.id, message) for own, message in wanted)

    def order_one(self, webhook: str, message: Message) -> str:
        """Store the delivery of a message to one webhook."""
        with self._database.write("webhook_deliveries") as connection:
            return self._order(connection, webhook, message)

    def _order(self, connection: sa.Connection, webhook: str, message: Message) -> str:
        new = Delivery(
            id=f"dlv-{secrets.token_hex(8)}",
            webhook=webhook,
            message=message.id,
            type=message.type,
            body=message.body().decode(),
            created=self._database.now(),
        )
        self.deliveries.put(connection, new)
        return new.id

    def delivery(self, id: str) -> Delivery | None:
        """Return the delivery; None if its webhook was removed."""
        return next(iter(self.deliveries.all(webhook_deliveries.c.id == id)), None)

    def pending(self) -> tuple[Delivery, ...]:
        """List all that are on their way, oldest first."""
        return self.deliveries.all(webhook_deliveries.c.state == "pending")

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
            self.deliveries.update(connection, delivery.id, tries=number, error=error, state=state, ended=ended)
            connection.execute(
                webhook_deliveries.delete().where(
                    table.webhook == delivery.webhook, table.state == "delivered", table.number <= old
                )
            )

    def failing(self) -> tuple[Webhook, ...]:
        """List those whose last delivery that ended was given up, by label."""
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
            query = sa.select(webhooks).where(last == "given_up").order_by(webhooks.c.label)
            return self.values(connection, connection.execute(query).all())
