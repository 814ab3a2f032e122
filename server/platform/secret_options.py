"""Secrets come by files and the environment: every user of a computer can read a command line."""

from __future__ import annotations

import re

import typer

from server.platform.errors import StartError


def no_secret(context: typer.Context, parameter: typer.CallbackParam, value: str | None) -> str | None:
    """The value of an option that may hold a URL; refused if it holds a password and was typed.

    Raises
    ------
    StartError
        If the URL on the command line holds a password.
    """
    name = str(parameter.name)
    source = context.get_parameter_source(name)
    typed = value is not None and source is not None and source.name == "COMMANDLINE"
    if typed and re.search("//[^/@]*:[^@]+@", value or ""):
        raise StartError(
            f"--{name.replace('_', '-')}: everybody here can read a password that is typed; leave it out and write it "
            "into a file that database_password_file (HILFIT_DATABASE_PASSWORD_FILE) names, or use HILFIT_DATABASE_URL"
        )
    return value
