"""Settings of the service: command line, then ``HILFIT_...`` in the environment, then these defaults."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from server.errors import StartError


class Settings(BaseSettings):
    """What a running service was told; immutable.

    Attributes
    ----------
    data_dir : directory of the database and of every file that the service keeps
    host, port : where HTTP is served; port 0 takes a free one
    simulate : start the simulated machine and acquire from it
    simulation_speed : its machine seconds per second
    maximum_upload_bytes : of one recording
    maximum_request_bytes : of any other request, machine files included
    stage_timeout_s : a stage of a job that takes longer is ended, and the job fails
    """

    model_config = SettingsConfigDict(env_prefix="HILFIT_", frozen=True, extra="forbid")

    data_dir: Path = Path("hilfit-data")
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8350
    simulate: bool = False
    simulation_speed: Annotated[float, Field(gt=0, le=4)] = 1.0
    maximum_upload_bytes: Annotated[int, Field(gt=0)] = 512 * 2**20
    maximum_request_bytes: Annotated[int, Field(gt=0)] = 2**20
    stage_timeout_s: Annotated[float, Field(gt=0)] = 3600.0


def load_settings(**given: Any) -> Settings:
    """Settings from ``given`` and the environment.

    Raises
    ------
    StartError
        One line with the first setting that cannot be used.
    """
    try:
        return Settings(**given)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(first["loc"][0])
        how = "--" + name.replace("_", "-") if name in given else f"HILFIT_{name.upper()}"
        raise StartError(f"{how}: {first['msg'].lower()} (found {first['input']!r})") from None


def is_loopback(host: str) -> bool:
    """Whether a name or address is of this computer only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def refuse_open_host(host: str) -> None:
    """Refuse to listen beyond this computer: there is no access control yet.

    Raises
    ------
    StartError
        If ``host`` is not a loopback address.
    """
    if not is_loopback(host):
        raise StartError(
            f"--host {host}: is reachable from other computers, and this version has no access control; "
            "use 127.0.0.1 (and a tunnel, if you need it elsewhere)"
        )
