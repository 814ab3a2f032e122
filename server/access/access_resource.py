"""The resource ``access``: devices and API keys."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from server.access.access_desk import Access
from server.access.connections import Presence
from server.access.holder_store import Holder, principals
from server.access.pairing import PairingWork, pairing_codes, pairing_url, qr_svg
from server.audit.audit_resource import Audit
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.authorization.principals import Role
from server.platform.database.engine import Database
from server.platform.errors import ConflictError
from server.platform.http.bodies import PLAIN, Body, Listed, Shown
from server.platform.http.route_parameters import Idempotency, PageDep, ServiceDep, problems
from server.platform.resource import Parts, Resource
from server.platform.service import Service
from server.platform.settings import Settings

Name = Annotated[str, Field(min_length=1, max_length=80, pattern=PLAIN)]
MachineNames = Annotated[list[Annotated[str, Field(max_length=80)]], Field(min_length=1, max_length=100)]


#: Days that a token is good for; null: as many as the service's setting ``token_days`` says.
Days = Annotated[int, Field(strict=True, ge=1, le=3650)]


class PrincipalResource(Shown):
    """Who asks; ``machines`` null: all of them.

    ``approves_own``: whether it may approve a calibration that it proposed.
    """

    id: str
    name: str
    role: Role
    machines: list[str] | None
    kind: Literal["device", "key", "local", "service"]
    approves_own: bool


class CodeOrder(Body, json_schema_extra={"examples": [{"role": "operator", "machines": ["folding-arm"], "days": 90}]}):
    """For which role, and for which machines (null: all), a device is to be paired."""

    role: Role
    machines: MachineNames | None = None
    days: Days | None = None


class CodeResource(BaseModel):
    """A pairing code, its address for the device to be paired, and that address as a QR code (SVG)."""

    code: str
    role: Role
    machines: list[str] | None
    expires: str
    url: str
    qr_svg: str


class Pairing(Body, json_schema_extra={"examples": [{"code": "0123456789", "name": "tablet at the press"}]}):
    """The code, and what the device is to be called."""

    code: Annotated[str, Field(pattern=r"^[0-9]{10}$")]
    name: Name


class Paired(BaseModel):
    """The device's token: it is shown this once."""

    token: str
    principal: PrincipalResource


class KeyOrder(Body, json_schema_extra={"examples": [{"name": "history of the plant", "role": "viewer", "days": 365}]}):
    """An API key for a program."""

    name: Name
    role: Role
    machines: MachineNames | None = None
    days: Days | None = None


class HolderResource(Holder):
    """A paired device or an API key.

    ``expires`` null: never. ``seen``, ``address``: its last request since the service started; ``streams``: that it
    has open now.
    """

    seen: str | None
    address: str | None
    streams: int


class NewKey(HolderResource):
    """An API key with its secret, which is shown this once."""

    key: str


class HolderList(Listed[HolderResource]):
    """A page of devices or keys."""


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
    """Return who asks."""
    return PrincipalResource.of(principal, approves_own=service.settings.approves_own)


@router.delete("/me", status_code=204, responses=problems(409), dependencies=[require("read")])
def end_me(service: ServiceDep, principal: PrincipalDep) -> None:
    """End the session of whoever asks: its token is worth nothing from now on, and its streams are closed."""
    if principal.kind not in ("device", "key"):
        raise ConflictError("server.whoever_computer_no_session")
    service[Access].holders.remove(principal.id, "device" if principal.kind == "device" else "key")


@router.get("/devices", responses=problems(422), dependencies=ADMIN)
def list_devices(service: ServiceDep, page: PageDep) -> HolderList:
    """List paired devices."""
    return HolderList.of(service[Access].holders.list(**page, kind="device"), partial(_resource, service))


@router.delete("/devices/{id}", status_code=204, responses=problems(404, 409, 422), dependencies=ADMIN)
def remove_device(id: str, service: ServiceDep) -> None:
    """Unpair a device: its token is worth nothing from now on, and its streams are closed."""
    service[Access].holders.remove(id, "device")


@router.get("/keys", responses=problems(422), dependencies=ADMIN)
def list_keys(service: ServiceDep, page: PageDep) -> HolderList:
    """List API keys."""
    return HolderList.of(service[Access].holders.list(**page, kind="key"), partial(_resource, service))


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


def _access(parts: Parts) -> Access:
    settings = parts[Settings]
    return Access(parts[Database], parts[Audit], settings.access == "required", settings.token_days)


def _pairing(parts: Parts) -> PairingWork:
    work = PairingWork()
    parts.at_close(work.close)
    return work


ACCESS = Resource(
    name="access",
    routers=(router,),
    tables=(principals, pairing_codes),
    provides={Access: _access, PairingWork: _pairing},
)
