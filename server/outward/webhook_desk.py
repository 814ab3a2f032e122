"""Webhooks: who gets messages by a signed POST, each at least once, or an alarm reports that it was given up."""

from __future__ import annotations

import http.client
import secrets
import ssl
import time
from collections.abc import Callable, Sequence

import sqlalchemy as sa
import structlog

from daq.messages import Sentence
from server.alarms.alarm_desk import Alarms
from server.outward.outward_message import Message, TrialData
from server.outward.webhook_post import WebhookSecrets, fingerprint, headers, post
from server.outward.webhook_store import Delivery, Event, Webhook, WebhookStore
from server.platform.authorization.principals import Principal
from server.platform.database.engine import Database
from server.platform.errors import InvalidError
from server.platform.processes.errands import Errand, Errands
from server.platform.receiver_places import Resolver, address_of, listed, receiver, resolved

#: s between a try that failed and the next: nearly a day in all. What fails once more is given up.
PAUSES_S = (5.0, 30.0, 120.0, 600.0, 3600.0, 10_800.0, 21_600.0, 43_200.0)
#: Tries at a time: more would wait for one receiver that hangs.
AT_ONCE = 8
ERRAND = "webhooks"
_log = structlog.stdlib.get_logger(__name__)


class Webhooks:
    """All webhooks of a site.

    Parameters
    ----------
    places : the administrator's list (:mod:`server.platform.receiver_places`)
    send : lets a delivery be tried, :meth:`server.platform.processes.errands.Errands.send`
    tls : authorities that vouch for receivers
    resolve : finds addresses of names
    pauses_s : between two tries
    """

    def __init__(
        self,
        database: Database,
        alarms: Alarms,
        signing: WebhookSecrets,
        errands: Errands,
        places: Sequence[str],
        tls: Callable[[], ssl.SSLContext],
        *,
        resolve: Resolver = resolved,
        pauses_s: Sequence[float] = PAUSES_S,
    ) -> None:
        self.store = WebhookStore(database)
        self._database = database
        self._alarms = alarms
        self._signing = signing
        self._errands = errands
        self._places = tuple(places)
        self._tls = tls
        self._resolve = resolve
        self._pauses_s = tuple(pauses_s)
        errands.add(Errand(ERRAND, AT_ONCE, self.attempt))

    def resume(self) -> None:
        """Resume all deliveries on their way, as those stored and not sent."""
        for delivery in self.store.pending():
            self._errands.send(ERRAND, delivery.id, delivery.tries + 1)
        self._report()

    def add(self, label: str, url: str, events: Sequence[Event], who: Principal) -> tuple[Webhook, bytes]:
        """Add a webhook; return its secret too, which is shown this once.

        Raises
        ------
        InvalidError
            If the administrator's list does not have the address.
        """
        try:
            wanted = receiver(url)
        except ValueError as error:
            raise InvalidError(str(error)) from None
        if not listed(wanted, self._places):
            place = f"{wanted.scheme}://{wanted.host}:{wanted.port}"
            raise InvalidError("server.not_webhook_places", place=place)
        id = f"whk-{secrets.token_hex(8)}"
        secret = self._signing.secret(id)
        new = Webhook(
            id=id,
            label=label or wanted.host,
            url=url,
            events=tuple(events),
            secret_sha256=fingerprint(secret),
            created=self._database.now(),
            created_by=who.name,
        )
        self.store.keep(new)
        return new, secret

    def remove(self, id: str) -> None:
        """Forget a webhook; what is on its way to it is tried no more."""
        self.store.remove(id)
        self._report()

    def order(self, connection: sa.Connection, messages: Sequence[Message]) -> Callable[[], None]:
        """Store deliveries in a transaction; what lets them be tried, once it is committed."""
        ordered = self.store.order(connection, messages)

        def committed() -> None:
            for delivery in ordered:
                self._errands.send(ERRAND, delivery)

        return committed

    def test(self, id: str) -> Delivery:
        """Send a message of type ``test`` to one webhook."""
        self.store.get(id)
        message = Message(f"msg-{secrets.token_hex(12)}", "test", None, self._database.now(), TrialData())
        ordered = self.store.order_one(id, message)
        self._errands.send(ERRAND, ordered)
        delivery = self.store.delivery(ordered)
        assert delivery is not None
        return delivery

    def attempt(self, id: str, number: int) -> float | None:
        """Try a delivery; s until the next try, None: it arrived, was given up, or its webhook was removed."""
        delivery = self.store.delivery(id)
        if delivery is None or delivery.state != "pending":
            self._report()  # we may have been killed before
            return None
        try:
            error = self._post(self.store.get(delivery.webhook), delivery)
        except _HopelessError as hopeless:
            error, number = str(hopeless), max(number, len(self._pauses_s) + 1)
        gives_up = error is not None and number > len(self._pauses_s)
        self.store.tried(delivery, number, error, "given_up" if gives_up else "pending" if error else "delivered")
        if error is None or gives_up:
            self._report()
        if error is not None:
            _log.warning("webhook_failed", webhook=delivery.webhook, delivery=id, attempt=number, reason=error)
        return self._pauses_s[number - 1] if error is not None and not gives_up else None

    def _post(self, webhook: Webhook, delivery: Delivery) -> str | None:
        """Post once; return why it failed, None if it arrived."""
        secret = self._signing.secret(webhook.id)
        if fingerprint(secret) != webhook.secret_sha256:
            raise _HopelessError(Sentence("server.secret_not_computer_remove"))
        to, body = receiver(webhook.url), delivery.body.encode()
        if not listed(to, self._places):
            raise _HopelessError(Sentence("server.address_no_longer_webhook_places"))
        try:
            address = address_of(to, self._places, self._resolve)
            if address is None:
                return Sentence("server.resolves_elsewhere", host=to.host)
            signed = headers(secret, delivery.message, int(time.time()), body)
            status = post(to, address, body, signed, self._tls())
        except (OSError, http.client.HTTPException, ValueError) as error:  # ValueError: a name that cannot be one
            return Sentence("server.no_answer", error=" ".join(str(error).split())[:200] or type(error).__name__)
        return None if 200 <= status < 300 else Sentence("server.receiver_answered", status=status)

    def _report(self) -> None:
        failing = [f"'{webhook.label}'" for webhook in self.store.failing()]
        text = Sentence("server.messages_given_up", webhooks=failing)
        self._alarms.report(None, "webhook_failed", text, "warning", bool(failing))


class _HopelessError(Exception):
    """No further try can succeed."""
