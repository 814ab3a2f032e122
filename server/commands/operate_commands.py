"""``hilfit access``, ``worker``, ``backup``, ``restore``: what whoever operates a service does at its computer."""

from __future__ import annotations

import re
import socket
from json import dumps
from pathlib import Path
from typing import Annotated, Any

import typer

from daq.console import Json, print_json, working


def _no_secret(context: typer.Context, parameter: typer.CallbackParam, value: str | None) -> str | None:
    """Return the value of an option that may hold a URL.

    Secrets come by files and the environment: every user of a computer can read a command line.

    Raises
    ------
    StartError
        If the URL was typed, and holds a password.
    """
    from server.platform.errors import StartError

    name = str(parameter.name)
    source = context.get_parameter_source(name)
    typed = value is not None and source is not None and source.name == "COMMANDLINE"
    if typed and re.search("//[^/@]*:[^@]+@", value or ""):
        raise StartError("server.password_typed", option=name.replace("_", "-"))
    return value


Config = Annotated[Path | None, typer.Option(help="Configuration file of the service.", dir_okay=False)]
DataDir = Annotated[Path | None, typer.Option(help="Data directory of the service.", file_okay=False)]
DatabaseUrl = Annotated[
    str | None,
    typer.Option(help="PostgreSQL of the service, without a password; else the SQLite.", callback=_no_secret),
]


def register(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Pair devices with a service that has access control.", no_args_is_help=True)
    group.callback()(lambda: None)  # or a lone command would not be a group
    group.command("pair")(pair)
    app.add_typer(group, name="access")
    app.command("worker")(worker)
    app.command("backup")(backup)
    app.command("restore")(restore)


def pair(
    role: Annotated[str, typer.Option(help="viewer, operator, engineer or admin.")] = "viewer",
    machine: Annotated[list[str] | None, typer.Option(help="Bind the device to this machine; may be repeated.")] = None,
    config: Config = None,
    data_dir: DataDir = None,
    database_url: DatabaseUrl = None,
    json: Annotated[bool, typer.Option("--json", help="Print the code as JSON.")] = False,
) -> None:
    """Make a code that pairs one device within a quarter of an hour; the service may run meanwhile."""
    from server.access.access_desk import Access
    from server.access.pairing import pairing_url, qr_text
    from server.audit.audit_resource import Audit
    from server.composition.declarations import TABLES
    from server.platform.authorization.principals import ROLES, Principal
    from server.platform.database.engine import Database, utc_now
    from server.platform.errors import StartError
    from server.platform.files import DATABASE_FILE, DataDirectory
    from server.platform.tls import certificate

    found = next((known for known in ROLES if known == role), None)
    if found is None:
        raise StartError("server.pair_role_unknown", role=role, roles=ROLES)
    settings = _settings_of(config, data_dir=data_dir, database_url=database_url)
    if settings.database_url is None and not (settings.data_dir / DATABASE_FILE).is_file():  # before one is made
        raise StartError("server.data_dir_without_store", root=settings.data_dir)
    files = DataDirectory(settings.data_dir)
    database = Database(
        settings.full_database_url or files.database,
        TABLES,
        changed=lambda: None,
        backups=files.backups,
        site=settings.site(files),
    )
    try:
        audit = Audit(database)
        by = Principal("command-line", "command line", "admin", None, "local")
        code = Access(database, audit, required=True).open_code(found, machine or None, by)
        audit.write(by, "access.make_pairing_code", "", {"role": found, "machines": machine or None})
    finally:
        database.close()
    found_tls = certificate(settings, files, utc_now)
    fingerprint = found_tls.fingerprint if found_tls is not None and found_tls.self_made else None
    url = pairing_url(settings.public_url(settings.port), code.digits, fingerprint)
    if json:
        print(dumps({"code": code.digits, "role": role, "expires": code.expires, "url": url}))
        return
    print(f"pairing code {code.digits} for the role {role}, until {code.expires}\n{url}\n{qr_text(url)}")


def worker(
    name: Annotated[str | None, typer.Option(help="Of this worker among all; the host's name.")] = None,
    config: Config = None,
    data_dir: DataDir = None,
    database_url: DatabaseUrl = None,
    json: Annotated[bool, typer.Option("--json", help="Print the worker's name as JSON once it takes jobs.")] = False,
) -> None:
    """Take numerical jobs of a service with PostgreSQL until stopped."""
    from server.composition.worker import work
    from server.platform.processes.leaving import leave

    own = name or socket.gethostname()
    settings = _settings_of(config, data_dir=data_dir, database_url=database_url)

    def ready() -> None:
        print(dumps({"worker": own}) if json else f"hilfit worker {own} takes jobs (Ctrl-C stops)", flush=True)

    work(settings, own, ready)
    leave()


def backup(
    output: Annotated[Path | None, typer.Option(help="Where; DATA_DIR/backups.", file_okay=False)] = None,
    config: Config = None,
    data_dir: DataDir = None,
    database_url: DatabaseUrl = None,
    json: Json = False,
) -> None:
    """Make a backup; the service may run meanwhile."""
    from server.backups.backup_archive import Backups
    from server.backups.backup_files import BackupContent
    from server.composition.declarations import RESOURCES
    from server.platform.database.engine import utc_now
    from server.platform.errors import StartError
    from server.platform.files import DATABASE_FILE, DataDirectory

    settings = _settings_of(config, data_dir=data_dir, database_url=database_url)
    missing = settings.database_url is None and not (settings.data_dir / DATABASE_FILE).is_file()
    if missing or not settings.data_dir.is_dir():
        raise StartError("server.data_dir_nothing_to_back_up", root=settings.data_dir)
    files = DataDirectory(settings.data_dir, settings.storage_url, settings.cache_bytes)
    backups = Backups(
        files, BackupContent.of(RESOURCES), settings.database(files), utc_now, output or settings.backup_dir
    )
    with working("making a backup", show=not json):
        made = backups.make()
    place = backups.directory / made.id
    if json:
        print_json({**made.__dict__, "path": str(place)})
    else:
        print(f"{place} ({made.bytes / 1e6:.1f} MB)")
        if made.missing:
            print(f"{len(made.missing)} files that the store names were not there: {', '.join(made.missing[:5])}")


def restore(
    source: Annotated[Path, typer.Argument(help="A backup: the directory with manifest.json.", metavar="BACKUP")],
    config: Config = None,
    data_dir: DataDir = None,
    database_url: DatabaseUrl = None,
    json: Json = False,
) -> None:
    """Put a backup in the place of what is there; the service has to be stopped."""
    from server.backups.backup_archive import manifest_of
    from server.backups.backup_archive import restore as put_back
    from server.backups.backup_files import BackupContent
    from server.composition.declarations import RESOURCES
    from server.platform.files import DataDirectory

    settings = _settings_of(config, data_dir=data_dir, database_url=database_url)
    manifest_of(source)  # before a data directory is made
    files = DataDirectory(settings.data_dir)
    with files.locked(), working("putting files back", show=not json):
        count = put_back(source, files, BackupContent.of(RESOURCES), settings.database(files))
    if json:
        print_json({"backup": str(source), "data_dir": str(files.root), "files": count})
    else:
        print(f"{count} files of {source} are back in {files.root}")


def _settings_of(config: Path | None, **given: Any) -> Any:
    """Load a service's settings, with the options given; what this process makes is its user's alone."""
    from server.platform.files import private_files
    from server.platform.settings import load_settings

    private_files()
    return load_settings(config, **{name: value for name, value in given.items() if value is not None})
