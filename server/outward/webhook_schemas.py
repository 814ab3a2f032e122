"""What ``/webhooks`` takes and gives."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from server.outward.webhook_store import Delivery, Event, Webhook
from server.platform.http.bodies import PLAIN, Body, Label, Listed


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
