"""What ``/webhooks`` takes and gives."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from server.outward.outward_message import Kind
from server.outward.webhook_store import Delivery, State, Webhook
from server.platform.http.bodies import PLAIN, Body, Label


class WebhookOrder(Body):
    """Where messages of which types are delivered to; ``url`` has to be in the setting ``webhook_places``."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"label": "shop", "url": "https://erp.example/hilfit", "events": ["alarm"]}]}
    )

    label: Label = ""
    url: Annotated[str, Field(max_length=500, pattern=PLAIN)]
    events: Annotated[tuple[Literal["alarm", "result"], ...], Field(min_length=1, max_length=2)] = ("alarm", "result")


class WebhookResource(BaseModel):
    """A webhook, without its secret."""

    id: str
    label: str
    url: str
    events: tuple[Literal["alarm", "result"], ...]
    created: str
    created_by: str

    @classmethod
    def of(cls, webhook: Webhook) -> WebhookResource:
        """From the store."""
        return cls(**{name: value for name, value in webhook.__dict__.items() if name in cls.model_fields})


class NewWebhook(WebhookResource):
    """A webhook and its secret (``whsec_...``), which is shown this once."""

    secret: str


class WebhookList(BaseModel):
    """A page of webhooks."""

    items: list[WebhookResource]
    next: int | None


class DeliveryResource(BaseModel):
    """A message on its way; ``message`` is what the receiver knows it by, ``error`` why the last try failed."""

    id: str
    message: str
    type: Kind
    state: State
    tries: int
    error: str | None
    created: str
    ended: str | None

    @classmethod
    def of(cls, delivery: Delivery) -> DeliveryResource:
        """From the store."""
        return cls(**{name: value for name, value in delivery.__dict__.items() if name in cls.model_fields})


class DeliveryList(BaseModel):
    """A page of deliveries."""

    items: list[DeliveryResource]
    next: int | None
