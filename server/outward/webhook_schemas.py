"""What ``/webhooks`` takes and gives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from server.outward.outward_message import Kind
from server.outward.webhook_store import State
from server.platform.http.bodies import PLAIN, Body, Label, Listed, Shown


class WebhookOrder(Body):
    """Where messages of which types are delivered to; ``url`` has to be in the setting ``webhook_places``."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"label": "shop", "url": "https://erp.example/hilfit", "events": ["alarm"]}]}
    )

    label: Label = ""
    url: Annotated[str, Field(max_length=500, pattern=PLAIN)]
    events: Annotated[tuple[Literal["alarm", "result"], ...], Field(min_length=1, max_length=2)] = ("alarm", "result")


class WebhookResource(Shown):
    """A webhook, without its secret."""

    id: str
    label: str
    url: str
    events: tuple[Literal["alarm", "result"], ...]
    created: str
    created_by: str


class NewWebhook(WebhookResource):
    """A webhook and its secret (``whsec_...``), which is shown this once."""

    secret: str


class WebhookList(Listed[WebhookResource]):
    """A page of webhooks."""


class DeliveryResource(Shown):
    """A message on its way; ``message`` is what the receiver knows it by, ``error`` why the last try failed."""

    id: str
    message: str
    type: Kind
    state: State
    tries: int
    error: str | None
    created: str
    ended: str | None


class DeliveryList(Listed[DeliveryResource]):
    """A page of deliveries."""
