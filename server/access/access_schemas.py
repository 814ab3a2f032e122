"""What the routes of access control and of the audit log take and give."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, Field

from server.access.holder_store import Holder
from server.platform.authorization.principals import Role
from server.platform.http.bodies import PLAIN, Body, Listed, Shown

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
