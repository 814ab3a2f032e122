"""``/access``: pair a device, list and revoke devices and API keys, say who asks."""

from __future__ import annotations

from functools import partial

from fastapi import APIRouter, Request, Response

from server.access.access_desk import Access
from server.access.access_schemas import (
    CodeOrder,
    CodeResource,
    HolderList,
    HolderResource,
    KeyOrder,
    NewKey,
    Paired,
    Pairing,
    PrincipalResource,
)
from server.access.connections import Presence
from server.access.holder_store import Holder
from server.access.pairing import PairingWork, pairing_url, qr_svg
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.typed_route import TypedRoute
from server.platform.errors import ConflictError
from server.platform.http.route_parameters import BetweenDep, Cursor, Idempotency, Limit, ServiceDep, problems
from server.platform.service import Service

router = APIRouter(prefix="/access", tags=["access"], route_class=TypedRoute)
ADMIN = [require("admin", every_machine=True)]


@router.post("/pair", status_code=201, responses=problems(403, 422))
async def pair(body: Pairing, request: Request, response: Response, service: ServiceDep) -> Paired:
    """Pair a device by a code that an admin made; the token is shown this once."""
    address = "unknown" if request.client is None else request.client.host
    # Codes are hashed at length: one after the other, and not in the threads that answer reads.
    holder, token = await service[PairingWork].run(address, service[Access].pair, body.code, body.name, address)
    response.headers["Cache-Control"] = "no-store"
    principal = PrincipalResource.of(holder.principal, approves_own=service.settings.approves_own)
    return Paired(token=token, principal=principal)


@router.post("/pairing-codes", status_code=201, responses=problems(409, 422, 429), dependencies=ADMIN)
def make_pairing_code(
    body: CodeOrder,
    request: Request,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    idempotency_key: Idempotency = None,
) -> CodeResource:
    """Make a code that pairs one device within a quarter of an hour; one ``Idempotency-Key`` makes one code."""

    def make() -> CodeResource:
        code = service[Access].open_code(body.role, body.machines, principal, body.days)
        place = str(request.base_url).rstrip("/") + service.settings.base_path
        url = pairing_url(place, code.digits, service.fingerprint)
        machines = None if code.machines is None else list(code.machines)
        return CodeResource(
            code=code.digits, role=code.role, machines=machines, expires=code.expires, url=url, qr_svg=qr_svg(url)
        )

    response.headers["Cache-Control"] = "no-store"
    return service.replays.once(principal.id, "pairing-codes", idempotency_key, body.model_dump(), make)


@router.get("/me", dependencies=[require("read")])
def me(service: ServiceDep, principal: PrincipalDep) -> PrincipalResource:
    """Who asks."""
    return PrincipalResource.of(principal, approves_own=service.settings.approves_own)


@router.delete("/me", status_code=204, responses=problems(409), dependencies=[require("read")])
def end_me(service: ServiceDep, principal: PrincipalDep) -> None:
    """End the session of whoever asks: its token is worth nothing from now on, and its streams are closed."""
    if principal.kind not in ("device", "key"):
        raise ConflictError("whoever is at this computer has no session that could be ended")
    service[Access].holders.remove(principal.id, "device" if principal.kind == "device" else "key")


@router.get("/devices", responses=problems(422), dependencies=ADMIN)
def list_devices(service: ServiceDep, between: BetweenDep, limit: Limit = 50, cursor: Cursor = 0) -> HolderList:
    """List paired devices."""
    return HolderList.of(
        service[Access].holders.list(limit, cursor, kind="device", between=between), partial(_resource, service)
    )


@router.delete("/devices/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=ADMIN)
def remove_device(id: str, service: ServiceDep) -> None:
    """Unpair a device: its token is worth nothing from now on, and its streams are closed."""
    service[Access].holders.remove(id, "device")


@router.get("/keys", responses=problems(422), dependencies=ADMIN)
def list_keys(service: ServiceDep, between: BetweenDep, limit: Limit = 50, cursor: Cursor = 0) -> HolderList:
    """List API keys."""
    return HolderList.of(
        service[Access].holders.list(limit, cursor, kind="key", between=between), partial(_resource, service)
    )


@router.get("/keys/{id}", responses=problems(404, 422), dependencies=ADMIN)
def get_key(id: str, service: ServiceDep) -> HolderResource:
    """Read an API key, without its secret."""
    return _resource(service, service[Access].holders.known_as("key", id))


@router.post("/keys", status_code=201, responses=problems(409, 422), dependencies=ADMIN)
def make_key(
    body: KeyOrder,
    response: Response,
    service: ServiceDep,
    principal: PrincipalDep,
    idempotency_key: Idempotency = None,
) -> NewKey:
    """Make an API key for a program; its secret is shown this once.

    Sent again with its ``Idempotency-Key`` within a quarter of an hour, the request makes no second key.
    """

    def make() -> NewKey:
        holder, secret = service[Access].make_key(body.name, body.role, body.machines, principal, body.days)
        return NewKey.of(holder, **vars(Presence()), key=secret)

    made = service.replays.once(principal.id, "keys", idempotency_key, body.model_dump(), make)
    response.headers["Location"] = f"/api/v1/access/keys/{made.id}"
    response.headers["Cache-Control"] = "no-store"
    return made


@router.delete("/keys/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=ADMIN)
def remove_key(id: str, service: ServiceDep) -> None:
    """Revoke an API key; its streams are closed."""
    service[Access].holders.remove(id, "key")


def _resource(service: Service, holder: Holder) -> HolderResource:
    return HolderResource.of(holder, **vars(service[Access].connections.of(holder.id)))
