"""The resource ``outward``: webhooks, MQTT, OPC UA."""

from __future__ import annotations

import secrets
import ssl
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import Field

from server.alarms.alarm_desk import Alarms
from server.identifications.identification_store import Identifications
from server.jobs.job_runner import JobRunner
from server.jobs.job_store import Jobs
from server.machines.acquisition import Acquisition
from server.outward.mqtt_publisher import MqttPublisher, mqtt_publisher
from server.outward.opcua_server import OpcuaServer, opcua_server
from server.outward.outward_stream import MessageReader, OutwardStream, alarm_message
from server.outward.webhook_desk import PAUSES_S, Webhooks
from server.outward.webhook_post import WebhookSecrets, receivers_tls, shown
from server.outward.webhook_store import Delivery, Event, State, Webhook, webhook_deliveries, webhooks
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.http.bodies import PLAIN, Body, Label, Listed
from server.platform.http.route_parameters import Idempotency, PageDep, ServiceDep, problems
from server.platform.receiver_places import Resolver, resolved
from server.platform.resource import PartName, Parts, Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings


class WebhookOrder(
    Body,
    json_schema_extra={"examples": [{"label": "shop", "url": "https://erp.example/hilfit", "events": ["alarm"]}]},
):
    """Where messages of which types are delivered to; ``url`` has to be in the setting ``webhook_places``."""

    label: Label = ""
    url: Annotated[str, Field(max_length=500, pattern=PLAIN)]
    events: Annotated[tuple[Event, ...], Field(min_length=1, max_length=2)] = ("alarm", "result")


class WebhookResource(Webhook):
    """A webhook, without its secret."""


class NewWebhook(WebhookResource):
    """A webhook and its secret (``whsec_...``), which is shown this once."""

    secret: str


class WebhookList(Listed[WebhookResource]):
    """A page of webhooks."""


class DeliveryResource(Delivery):
    """A message on its way; ``message`` is what the receiver knows it by, ``error`` why the last try failed."""


class DeliveryList(Listed[DeliveryResource]):
    """A page of deliveries."""


router = APIRouter(prefix="/webhooks", tags=["webhooks"], route_class=TypedRoute)
ADMIN = [require("admin", every_machine=True)]


@router.post("", status_code=201, responses=problems(409, 422), dependencies=ADMIN)
def add_webhook(
    body: WebhookOrder,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    idempotency_key: Idempotency = None,
) -> NewWebhook:
    """Add a webhook; its secret is shown this once. Its address has to be in the setting ``webhook_places``.

    Sent again with its ``Idempotency-Key`` within a quarter of an hour, the request makes no second one.
    """

    def make() -> NewWebhook:
        webhook, secret = service[Webhooks].add(body.label, body.url, body.events, principal)
        return NewWebhook.of(webhook, secret=shown(secret))

    made = service.replays.once(principal.id, "webhooks", idempotency_key, body.model_dump(), make)
    response.headers["Location"] = f"/api/v1/webhooks/{made.id}"
    response.headers["Cache-Control"] = "no-store"
    return made


@router.get("", responses=problems(422), dependencies=ADMIN)
def list_webhooks(service: ServiceDep, page: PageDep) -> WebhookList:
    """List webhooks, newest first."""
    return WebhookList.of(service[Webhooks].store.list(**page))


@router.get("/{id}", responses=problems(404, 422), dependencies=ADMIN)
def get_webhook(id: str, service: ServiceDep) -> WebhookResource:
    """Read a webhook, without its secret."""
    return WebhookResource.of(service[Webhooks].store.get(id))


@router.delete("/{id}", status_code=204, responses=problems(404, 422), dependencies=ADMIN)
def remove_webhook(id: str, service: ServiceDep) -> None:
    """Remove a webhook and what is known of its deliveries; what is on its way is tried no more."""
    service[Webhooks].remove(id)


@router.post("/{id}/test", status_code=202, responses=problems(404, 422), dependencies=ADMIN)
def test_webhook(id: str, response: Response, service: ServiceDep) -> DeliveryResource:
    """Send a message of type ``test``; what becomes of it is in the list at ``Location``."""
    delivery = service[Webhooks].test(id)
    response.headers["Location"] = f"/api/v1/webhooks/{id}/deliveries"
    return DeliveryResource.of(delivery)


@router.get("/{id}/deliveries", responses=problems(404, 422), dependencies=ADMIN)
def list_deliveries(id: str, service: ServiceDep, page: PageDep, state: State | None = None) -> DeliveryList:
    """List messages to a webhook, newest first: on their way, delivered (the last 500), given up (all)."""
    own = service[Webhooks].store.get(id).id
    return DeliveryList.of(service[Webhooks].store.deliveries.list(**page, webhook=own, state=state))


#: What says messages beside webhooks, as the settings ask for.
PUBLISHERS: PartName[tuple[MqttPublisher | OpcuaServer, ...]] = PartName("publishers of messages")
#: How names of receivers are resolved, and s between tries of a delivery.
RESOLVER: PartName[Resolver] = PartName("resolver of receivers")
PAUSES: PartName[Sequence[float]] = PartName("pauses between tries")


def _webhooks(parts: Parts) -> Webhooks:
    settings = parts[Settings]

    @cache
    def tls() -> ssl.SSLContext:
        return receivers_tls(settings.webhook_ca)

    if settings.webhook_ca is not None:
        tls()  # refused at the start if it cannot be read
    return Webhooks(
        parts[Database],
        parts[Alarms],
        WebhookSecrets(parts[DataDirectory].root / "webhooks" / "site.key"),
        parts[JobRunner].errands,
        settings.webhook_places,
        tls,
        resolve=parts[RESOLVER],
        pauses_s=parts[PAUSES],
    )


def _stream(parts: Parts) -> OutwardStream:
    identifications = parts[Identifications]
    reader = MessageReader(parts[Jobs], parts[Service].ownership, lambda id: identifications.get(id).verdict)
    webhooks = parts[Webhooks]
    return OutwardStream(parts[Database], parts[Changes], reader, parts[Acquisition], webhooks.order, webhooks.resume)


def _publishers(parts: Parts) -> tuple[MqttPublisher | OpcuaServer, ...]:
    made = (mqtt_publisher(parts[Settings]), opcua_server(parts[Settings]))
    return tuple(publisher for publisher in made if publisher is not None)


def _running(parts: Parts) -> Iterator[Running]:
    stream, publishers = parts[OutwardStream], parts[PUBLISHERS]

    def start() -> None:
        active = parts[Alarms].active()
        stream.start(
            publishers,
            [alarm_message(f"msg-{secrets.token_hex(12)}", own.columns(), parts[Database].now()) for own in active],
        )

    for publisher in publishers:
        yield Running(Phase.WATCHING, publisher.start, publisher.stop)
    yield Running(Phase.WATCHING, start, stream.stop)


OUTWARD = Resource(
    name="outward",
    routers=(router,),
    tables=(webhooks, webhook_deliveries),
    provides={
        Webhooks: _webhooks,
        OutwardStream: _stream,
        PUBLISHERS: _publishers,
        RESOLVER: lambda parts: resolved,
        PAUSES: lambda parts: PAUSES_S,
    },
    running=_running,
)
