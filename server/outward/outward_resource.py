"""The resource ``outward``: webhooks, MQTT, OPC UA."""

from __future__ import annotations

import secrets
import ssl
from collections.abc import Iterator, Sequence
from functools import cache

from server.alarms.alarm_desk import Alarms
from server.identifications.identification_store import Identifications
from server.jobs.job_runner import JobRunner
from server.jobs.job_store import Jobs
from server.machines.acquisition import Acquisition
from server.outward.mqtt_publisher import MqttPublisher, mqtt_publisher
from server.outward.opcua_server import OpcuaServer, opcua_server
from server.outward.outward_stream import MessageReader, OutwardStream, alarm_message
from server.outward.webhook_desk import PAUSES_S, Webhooks
from server.outward.webhook_post import receivers_tls
from server.outward.webhook_routes import router
from server.outward.webhook_signing import WebhookSecrets
from server.outward.webhook_store import webhook_deliveries, webhooks
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.receiver_places import Resolver, resolved
from server.platform.resource import Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings

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
