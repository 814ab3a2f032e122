"""``hilfit access``: what an admin does at the computer of the service."""

from __future__ import annotations

import json as json_format
from typing import Annotated

import typer

from server.commands.operate_commands import Config, DatabaseUrl, DataDir, settings_of


def register(app: typer.Typer) -> None:
    """Add the commands."""
    group = typer.Typer(help="Pair devices with a service that has access control.", no_args_is_help=True)
    group.callback()(lambda: None)  # or a lone command would not be a group
    group.command("pair")(pair)
    app.add_typer(group, name="access")


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
    from server.audit.audit_log import Audit
    from server.composition.declarations import TABLES
    from server.platform.authorization.principals import ROLES, Principal
    from server.platform.database.engine import Database, utc_now
    from server.platform.errors import StartError
    from server.platform.files import DATABASE_FILE, DataDirectory
    from server.platform.tls import certificate

    found = next((known for known in ROLES if known == role), None)
    if found is None:
        raise StartError(f"--role {role}: is no role; use one of {', '.join(ROLES)}")
    settings = settings_of(config, data_dir=data_dir, database_url=database_url)
    if settings.database_url is None and not (settings.data_dir / DATABASE_FILE).is_file():  # before one is made
        raise StartError(f"--data-dir {settings.data_dir}: holds no store; start 'hilfit serve' once")
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
        print(json_format.dumps({"code": code.digits, "role": role, "expires": code.expires, "url": url}))
        return
    print(f"pairing code {code.digits} for the role {role}, until {code.expires}\n{url}\n{qr_text(url)}")
