"""``/webhooks``: add, list, try and remove them; what became of their messages."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Response
from pydantic import Field

from server.outward.webhook_desk import Webhooks
from server.outward.webhook_signing import shown
from server.outward.webhook_store import Delivery, Event, State, Webhook
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.http.bodies import PLAIN, Body, Label, Listed
from server.platform.http.route_parameters import Idempotency, PageDep, ServiceDep, problems


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
