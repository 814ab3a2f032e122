"""``/access``: pair a device, list and revoke devices and API keys, say who asks."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response

from server.access.guard import PrincipalDep, require
from server.access.pairing import pairing_url, qr_svg
from server.access.resources import (
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
from server.routes.common import Cursor, Limit, ServiceDep, problems

router = APIRouter(prefix="/access", tags=["access"])
ADMIN = [require("admin", every_machine=True)]


@router.post("/pair", status_code=201, responses=problems(403, 422))
def pair(body: Pairing, response: Response, service: ServiceDep) -> Paired:
    """Pair a device by a code that an admin made; the token is shown this once."""
    holder, token = service.access.pair(body.code, body.name)
    response.headers["Cache-Control"] = "no-store"
    return Paired(token=token, principal=PrincipalResource.of(holder.principal))


@router.post("/pairing-codes", status_code=201, responses=problems(422, 429), dependencies=ADMIN)
def make_pairing_code(
    body: CodeOrder, request: Request, response: Response, service: ServiceDep, principal: PrincipalDep
) -> CodeResource:
    """Make a code that pairs one device within a quarter of an hour."""
    code = service.access.open_code(body.role, body.machines, principal)
    url = pairing_url(str(request.base_url).rstrip("/"), code.digits)
    response.headers["Cache-Control"] = "no-store"
    machines = None if code.machines is None else list(code.machines)
    return CodeResource(
        code=code.digits, role=code.role, machines=machines, expires=code.expires, url=url, qr_svg=qr_svg(url)
    )


@router.get("/me", dependencies=[require("read")])
def me(principal: PrincipalDep) -> PrincipalResource:
    """Who asks."""
    return PrincipalResource.of(principal)


@router.get("/devices", responses=problems(422), dependencies=ADMIN)
def list_devices(service: ServiceDep, limit: Limit = 50, cursor: Cursor = 0) -> HolderList:
    """List paired devices."""
    return HolderList.of(service.access.holders.list("device", limit, cursor))


@router.delete("/devices/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=ADMIN)
def remove_device(id: str, service: ServiceDep) -> None:
    """Unpair a device: its token is worth nothing from now on."""
    service.access.holders.remove(id, "device")


@router.get("/keys", responses=problems(422), dependencies=ADMIN)
def list_keys(service: ServiceDep, limit: Limit = 50, cursor: Cursor = 0) -> HolderList:
    """List API keys."""
    return HolderList.of(service.access.holders.list("key", limit, cursor))


@router.get("/keys/{id}", responses=problems(404, 422), dependencies=ADMIN)
def get_key(id: str, service: ServiceDep) -> HolderResource:
    """Read an API key, without its secret."""
    return HolderResource.of(service.access.holders.get(id, "key"))


@router.post("/keys", status_code=201, responses=problems(422), dependencies=ADMIN)
def make_key(body: KeyOrder, response: Response, service: ServiceDep, principal: PrincipalDep) -> NewKey:
    """Make an API key for a program; its secret is shown this once."""
    holder, secret = service.access.make_key(body.name, body.role, body.machines, principal)
    response.headers["Location"] = f"/api/v1/access/keys/{holder.id}"
    response.headers["Cache-Control"] = "no-store"
    return NewKey(**HolderResource.of(holder).model_dump(), key=secret)


@router.delete("/keys/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=ADMIN)
def remove_key(id: str, service: ServiceDep) -> None:
    """Revoke an API key."""
    service.access.holders.remove(id, "key")
