"""Settings of the service: command line, ``HILFIT_...`` in the environment, the file of ``--config``, defaults.

What stands further to the left counts.
"""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import sqlalchemy as sa
import yaml
from pydantic import AfterValidator, Field, ValidationError
from pydantic_settings import BaseSettings, SettingsConfigDict

from daq import safe_yaml
from daq.machine.bus_places import check_entry
from daq.validation_words import in_words
from server.platform.database.database_copies import postgresql_url
from server.platform.database.site_marker import SiteMarker
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.platform.http.base_path import BASE_PATH
from server.platform.receiver_places import check_receiver_entry


class Settings(BaseSettings):
    """Settings of a running service; immutable.

    Attributes
    ----------
    data_dir : directory of the database and of every file that the service keeps
    database_url : PostgreSQL that several hosts share, ``postgresql://user:password@host/name``; without it a SQLite
        file in ``data_dir``
    database_password_file : file that holds the password of ``database_url`` alone
    storage_url : what hosts share of the data directory, ``s3://bucket/folder`` or ``file:///mount/folder``: inputs and
        results of jobs; without it workers need the server's ``data_dir``
    cache_bytes : that a worker keeps of what it fetched from there
    recordings_at_once : recordings that recalibrations make at a time; the others wait, and hold up nobody
    new_store : make a new store where there was one; what it knew is then known no more
    local_jobs : the server runs numerical jobs itself; else only ``hilfit worker`` processes do
    backup_dir : where backups are kept; by default ``backups`` in ``data_dir``
    tls_cert, tls_key : files of a certificate and its key (PEM): HTTPS, and nothing else, is served
    tls : ``self-signed``: with a certificate that the service makes for itself and keeps in ``data_dir``; its
        fingerprint goes with the pairing code
    host, port : where HTTP is served; port 0 takes a free one
    access : ``required``: every request needs a token; ``loopback``: none does, and HTTP is for this computer only
    public_hosts : names by which other computers reach the service, ``hilfit.example`` or with a port; the first is
        printed, and behind a proxy that adds TLS it is ``https://hilfit.example``; addresses need not be listed
    base_path : path of a reverse proxy that the whole service stands below, ``/hilfit``
    trusted_proxies : addresses of proxies whose ``X-Forwarded-For`` and ``X-Forwarded-Proto`` are believed
    token_days : that the token of a paired device or an API key is good for, unless an admin says another number
    second_person : whether whoever proposed a calibration may not approve it; by default where access control is on
        (without it there is only one principal)
    requests_per_second : of each paired device and API key in the long run, four times as many at once
    bus_places : where uploaded machines may be acquired from, ``can:socketcan:can0``, ``serial:/dev/ttyUSB*`` or
        ``tcp:192.0.2.0/24:502`` (:mod:`daq.machine.bus_places`); by default nowhere
    webhook_places : where webhooks may be delivered to, ``https://erp.example`` or ``https://erp.example in
        192.0.2.0/24`` (:mod:`server.platform.receiver_places`); by default nowhere
    webhook_ca : authorities (PEM) that vouch for their receivers, in the place of the computer's own
    mqtt_url : broker that states, results and alarms are published at, ``mqtts://host[:port]`` or ``mqtt://host[:port]``
    mqtt_prefix : what its topics begin with
    mqtt_ca : authorities (PEM) that vouch for it, in the place of the computer's own
    mqtt_user, mqtt_password_file : as whom, and the file that holds the password alone
    opcua : address and port of an OPC UA server of the same, ``127.0.0.1:4840``; other than this computer's it needs
        all that follows
    opcua_cert, opcua_key : files of its certificate and its key (PEM); then nothing is sent in the clear
    opcua_user, opcua_password_file : who may read, and the file that holds the password alone
    simulate : start the simulated machine and acquire from it
    simulation_speed : its machine seconds per second
    faults : a fault file, what breaks in it while it runs
    maximum_upload_bytes : of one recording
    maximum_request_bytes : of any other request, machine files included
    stage_timeout_s : a stage of a job that takes longer is ended, and the job fails
    recalibrate_on_drift : a drift of the residual does at once what the machine's schedule does; else it only alarms
    """

    model_config = SettingsConfigDict(env_prefix="HILFIT_", frozen=True, extra="forbid")

    data_dir: Path = Path("hilfit-data")
    database_url: str | None = None
    database_password_file: Path | None = None
    storage_url: str | None = None
    cache_bytes: Annotated[int, Field(gt=0)] = 4 * 2**30
    recordings_at_once: Annotated[int, Field(ge=1, le=1000)] = 64
    backup_dir: Path | None = None
    new_store: bool = False
    local_jobs: bool = True
    tls_cert: Path | None = None
    tls_key: Path | None = None
    tls: Literal["off", "self-signed"] = "off"
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8350
    access: Literal["loopback", "required"] = "loopback"
    public_hosts: tuple[Annotated[str, Field(pattern=r"^(https?://)?[^/\s]+$")], ...] = ()
    base_path: Annotated[str, Field(max_length=200, pattern=BASE_PATH)] = ""
    trusted_proxies: tuple[str, ...] = ()
    token_days: Annotated[int, Field(ge=1, le=3650)] = 365
    second_person: bool | None = None
    requests_per_second: Annotated[float, Field(gt=0, le=10_000)] = 100.0
    bus_places: tuple[Annotated[str, AfterValidator(check_entry)], ...] = ()
    webhook_places: tuple[Annotated[str, AfterValidator(check_receiver_entry)], ...] = ()
    webhook_ca: Path | None = None
    mqtt_url: str | None = None
    mqtt_prefix: Annotated[str, Field(pattern=r"^[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+)*$")] = "hilfit"
    mqtt_ca: Path | None = None
    mqtt_user: str | None = None
    mqtt_password_file: Path | None = None
    opcua: str | None = None
    opcua_cert: Path | None = None
    opcua_key: Path | None = None
    opcua_user: str | None = None
    opcua_password_file: Path | None = None
    simulate: bool = False
    simulation_speed: Annotated[float, Field(gt=0, le=4)] = 1.0
    faults: Path | None = None
    maximum_upload_bytes: Annotated[int, Field(gt=0)] = 512 * 2**20
    maximum_request_bytes: Annotated[int, Field(gt=0)] = 2**20
    stage_timeout_s: Annotated[float, Field(gt=0)] = 3600.0
    recalibrate_on_drift: bool = False

    @property
    def approves_own(self) -> bool:
        """True if a calibration may be approved by whoever proposed it."""
        return self.access == "loopback" if self.second_person is None else not self.second_person

    def database(self, files: DataDirectory) -> str:
        """Return the URL of the database."""
        url = self.full_database_url
        return f"sqlite:///{files.database}" if url is None else postgresql_url(url)

    @property
    def full_database_url(self) -> str | None:
        """URL of PostgreSQL with its password; StartError if the file that holds it cannot be read."""
        if self.database_url is None or self.database_password_file is None:
            return self.database_url
        password = self.password("database")
        postgresql_url(self.database_url)  # else SQLAlchemy says something about a URL that it cannot parse
        return sa.make_url(self.database_url).set(password=password).render_as_string(hide_password=False)

    def password(self, of: str) -> str | None:
        """Read the password in ``<of>_password_file``; None without one, StartError if it is unreadable."""
        path: Path | None = getattr(self, f"{of}_password_file")
        try:
            return None if path is None else path.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise StartError("server.password_file_not_readable", service=of, path=path, error=error) from None

    def site(self, files: DataDirectory) -> SiteMarker:
        """Return the marker of the site that this data directory belongs to."""
        return SiteMarker(files.root, self.backup_dir or files.backups, self.new_store)

    @property
    def scheme(self) -> str:
        """``http`` or ``https``."""
        return "http" if self.tls == "off" and self.tls_cert is None else "https"

    def public_url(self, port: int) -> str:
        """Return the address that other computers use, as far as it is known here."""
        first = next(iter(self.public_hosts), None)
        if first is None:
            return self.local_url(port)
        if "://" in first:
            return f"{first}{self.base_path}"
        return self.url(first if ":" in first else f"{first}:{port}")

    @property
    def public_names(self) -> tuple[str, ...]:
        """``public_hosts`` without how they are reached."""
        return tuple(host.rpartition("://")[2] for host in self.public_hosts)

    def local_url(self, port: int) -> str:
        """Return the address that it listens at."""
        return self.url(f"[{self.host}]:{port}" if ":" in self.host else f"{self.host}:{port}")

    def url(self, place: str) -> str:
        """Return the address of the page at a name with a port."""
        return f"{self.scheme}://{place}{self.base_path}"


def load_settings(config: Path | None = None, **given: Any) -> Settings:
    """Load settings from ``given``, the environment, and the YAML file ``config``.

    Raises
    ------
    StartError
        One line with the first setting that cannot be used, or is not known.
    """
    written = {} if config is None else _read_config(config)
    # What the environment says counts more than the file, so the file must not hand it over as given.
    below = {key: value for key, value in written.items() if f"HILFIT_{key.upper()}" not in os.environ}
    try:
        return Settings(**{**below, **given})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = str(first["loc"][0])
        if name in given:
            how = "--" + name.replace("_", "-")
        else:
            how = f"{config}: {name}" if name in below else f"HILFIT_{name.upper()}"
        raise StartError(
            "server.setting_wrong", setting=how, what=in_words(first), found=repr(first["input"])
        ) from None


def is_loopback(host: str) -> bool:
    """Test whether a name or address is of this computer only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def refuse_open_host(settings: Settings) -> None:
    """Refuse to listen beyond this computer without access control.

    Raises
    ------
    StartError
        If ``host`` is not a loopback address and ``access`` is not ``required``.
    """
    if settings.access != "required" and not is_loopback(settings.host):
        raise StartError("server.host_open", host=settings.host)


def _read_config(path: Path) -> Mapping[str, Any]:
    """Read the content of a configuration file; StartError, one line, if it is none."""
    try:
        content = safe_yaml.read(path.read_text(encoding="utf-8"))[1]
    except OSError as error:
        raise StartError("server.not_readable", path=path, reason=error.strerror) from None
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise StartError("server.config_no_yaml", path=path, error=" ".join(str(error).split())) from None
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise StartError("server.config_no_lines", path=path, type=type(content).__name__)
    for key in content:
        if key not in Settings.model_fields:
            raise StartError("server.config_no_setting", path=path, key=key, known=sorted(Settings.model_fields))
    return content
