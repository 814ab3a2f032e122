"""Conventions of all commands: words for values in the help, and names of options in the environment.

An option ``--seed`` of ``hilfit excite`` is ``HILFIT_EXCITE_SEED`` in the environment: one name means one thing.
Without the command stand the settings of the service (``HILFIT_PORT``) and what means the same in all commands
(``HILFIT_JSON``).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

#: Commands whose options are settings of the service (:class:`server.platform.settings.Settings`).
SERVICE_COMMANDS = ("serve", "worker", "backup", "restore", "access pair")
#: Settings of the service that are options of these commands; a test holds them against the settings.
SERVICE_OPTIONS = frozenset(
    {
        "base_path", "data_dir", "database_url", "faults", "host", "port", "simulate", "simulation_speed", "tls",
        "tls_cert", "tls_key",
    }
)  # fmt: skip
#: Options that mean the same in every command.
COMMON_OPTIONS = frozenset({"json", "config", "data_dir"})

#: Words of the help for values that are more than their kind, and the parameters that take them.
_NAMED = {
    "RECORDING": ("recordings", "recording", "train", "validate", "unloaded", "repeat", "operation"),
    "MODEL": ("model", "first", "second"),
    "MACHINE": ("machine",),
    "MOTION": ("motion", "after"),
    "JOINT": ("joint",),
    "SECONDS": ("seconds",),
    "SEED": ("seed",),
    "MAP": ("columns",),
    "HZ": ("bandwidth", "max_frequency", "rate"),
    "ADDRESS": ("host",),
    "PORT": ("port",),
    "PATH": ("base_path",),
    "URL": ("database_url",),
    "EFFECT:JOINT:SIZE": ("undeclared",),
    "CHANNEL": ("require",),
    "ID": ("effect_id",),
    "FILE": ("source",),
    "FORMAT": ("to",),
}
METAVARS = {name: word for word, names in _NAMED.items() for name in names}
#: The same by command, where a name means something else.
METAVARS_OF_COMMANDS = {
    ("access pair", "machine"): "NAME",
    ("machine check", "file"): "MACHINE",
    ("export", "file"): "RECORDING",
    ("restore", "source"): "BACKUP",
    ("replay", "trace"): "TRACE",
    ("service", "rate"): "N",
}
#: By kind, for all others. A directory is what takes no file, or is called one.
METAVARS_OF_KINDS: Mapping[type, str] = {Path: "FILE", int: "N", float: "NUMBER", str: "NAME"}
_DIRECTORIES = frozenset({"directory", "data_dir", "workdir", "cache", "data", "samples"})
_DIRECTORY_OUTPUTS = frozenset({"demo", "identify", "valve", "valve-motion", "backup"})


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command.

    Attributes
    ----------
    command : its words after ``hilfit``, ``effects show``
    own : as typer has it
    """

    command: str
    own: Any

    @property
    def option(self) -> str | None:
        """``--max-flow``; None for an argument and for ``--help``."""
        long = [name for name in self.own.opts if name.startswith("--")]
        return long[0] if self.own.param_type_name == "option" and long and long[0] != "--help" else None


def walk(command: Any, words: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every command below one that can be run, with its words after ``hilfit``."""
    subcommands: Mapping[str, Any] = getattr(command, "commands", {})
    if not subcommands or (command.callback is not None and getattr(command, "invoke_without_command", False)):
        yield words, command
    for name, own in subcommands.items():
        yield from walk(own, f"{words} {name}".strip())


def apply(command: Any) -> None:
    """Name values and environment variables of a command and its subcommands.

    Raises
    ------
    InputError
        If the environment has an option by the name without the command, which several commands would read.
    """
    for words, own in walk(command):
        for parameter in (Parameter(words, each) for each in own.params):
            word = metavar(parameter)
            if word is not None:
                parameter.own.metavar = word
            if parameter.option is not None and not parameter.own.envvar:
                parameter.own.envvar = _environment_name(words, parameter.option)


def _environment_name(command: str, option: str) -> str:
    """Return ``HILFIT_EXCITE_SEED`` for ``--seed`` of ``excite``; ``HILFIT_PORT`` for a service setting."""
    name = option[2:].replace("-", "_")
    shared = name in COMMON_OPTIONS or (command in SERVICE_COMMANDS and name in SERVICE_OPTIONS)
    before = "" if shared else f"{command} "
    return "HILFIT_" + f"{before}{name}".upper().replace(" ", "_").replace("-", "_")


def metavar(parameter: Parameter) -> str | None:
    """Return the word for a parameter's value; None for a switch, and a choice, which lists its values."""
    own, name, command = parameter.own, str(parameter.own.name), parameter.command.removeprefix("bench ")
    described = own.type_descriptor
    kind = next(iter(get_args(described.annotation)), described.annotation)
    if kind not in METAVARS_OF_KINDS:
        return None
    word = METAVARS_OF_COMMANDS.get((command, name)) or METAVARS.get(name)
    if word is not None:
        return word
    folder = name in _DIRECTORIES or (name == "output" and command in _DIRECTORY_OUTPUTS)
    return "DIR" if kind is Path and (folder or not described.parameter_info.file_okay) else METAVARS_OF_KINDS[kind]


def refuse_old_names(command: str, own: Any) -> None:
    """Refuse an environment with ``HILFIT_SEED``, which several commands once read.

    Raises
    ------
    InputError
        With the name that counts now.
    """
    from daq.errors import InputError  # not for the help, which has to be quick

    for parameter in (Parameter(command, each) for each in own.params):
        if parameter.option is None:
            continue
        name = parameter.option[2:].replace("-", "_")
        old, new = f"HILFIT_{name.upper()}", str(parameter.own.envvar)
        if old != new and old in os.environ and name not in SERVICE_OPTIONS:
            raise InputError("server.environment_name_old", old=old, option=parameter.option, new=new, command=command)
