"""The ``hilfit`` command: mounts the commands of all packages, turns errors into one line and an exit code.

Exit codes: 0 done, 1 failed, 2 bad usage or input, 130 interrupted. Every option can be set in the
environment: ``--data-dir`` by ``HILFIT_DATA_DIR``. Nothing heavy is imported before a command needs it.
"""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

#: Modules with ``register(app)`` in the order of the help text, and their commands that need an extra.
PARTS: dict[str, tuple[str, ...]] = {
    "server.demo": ("demo",),
    "fitting.cli": (),
    "fitting.cli_excite": (),
    "daq.cli": (),
    "sim_backends.cli": ("simulate",),
}
#: Modules that come with an extra of the distribution.
EXTRAS = {"mujoco": "sim"}


def build() -> typer.Typer:
    """The command with everything mounted."""
    app = typer.Typer(
        name="hilfit",
        help="Hardware-in-the-loop acquisition and fitting for hydraulically driven arms.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for part, commands in PARTS.items():
        mount(app, part, commands)
    register(app)
    return app


def mount(app: typer.Typer, part: str, commands: Sequence[str]) -> None:
    """Mount the commands of module ``part``; without its extra, each of ``commands`` says so when it is used."""
    try:
        import_module(part).register(app)
    except ModuleNotFoundError as error:
        missing = error
        if missing.name == part:
            return
        if _extra(missing) is None:
            raise

        def unavailable(context: typer.Context) -> None:
            raise missing

        anything = {"allow_extra_args": True, "ignore_unknown_options": True}
        text = f"Needs the extra 'hilfit[{_extra(missing)}]', which is not installed."
        for command in commands:
            app.command(command, help=text, context_settings=anything)(unavailable)


def register(app: typer.Typer) -> None:
    """Add the commands of the service."""
    app.command()(serve)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    try:
        command = typer.main.get_command(build())
        name_environment(command)
        command.main(None if arguments is None else list(arguments), prog_name="hilfit")
    except ModuleNotFoundError as error:
        extra = _extra(error)
        if extra is None:
            raise
        _fail(f"this needs {error.name}, which is not installed; run: pip install 'hilfit[{extra}]'", 2)
    except Exception as error:
        from daq.errors import HilfitError, InputError

        if not isinstance(error, HilfitError):
            raise
        _fail(str(error), 2 if isinstance(error, InputError) else 1)


def name_environment(command: Any) -> None:
    """Let ``HILFIT_<OPTION>`` in the environment set every option of a command and its subcommands."""
    for parameter in command.params:
        long = [name for name in parameter.opts if name.startswith("--")]
        if parameter.param_type_name == "option" and long and long[0] not in ("--help", "--version"):
            parameter.envvar = parameter.envvar or "HILFIT_" + long[0][2:].upper().replace("-", "_")
    for subcommand in getattr(command, "commands", {}).values():
        name_environment(subcommand)


def serve(
    host: Annotated[str, typer.Option(help="Address to listen on; of this computer only.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one.", min=0, max=65535)] = 8350,
    data_dir: Annotated[Path, typer.Option(help="Directory of the database and all files.", file_okay=False)] = Path(
        "hilfit-data"
    ),
    simulate: Annotated[bool, typer.Option(help="Start the simulated machine and acquire from it.")] = False,
    simulation_speed: Annotated[
        float, typer.Option(help="Machine seconds per second of the simulated machine, up to 4.")
    ] = 1.0,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Serve machines, recordings and identifications over HTTP until stopped."""
    from server.serve import serve as run
    from server.settings import load_settings

    def ready(url: str) -> None:
        print(json_format.dumps({"url": url}) if json else f"hilfit serves on {url} (Ctrl-C stops)", flush=True)

    settings = load_settings(
        host=host, port=port, data_dir=data_dir, simulate=simulate, simulation_speed=simulation_speed
    )
    run(settings, ready)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"hilfit {version('hilfit')}")
        raise typer.Exit


def _root(
    show_version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Options of the command itself."""


def _extra(error: ModuleNotFoundError) -> str | None:
    """The extra that brings the module that was not found."""
    return EXTRAS.get((error.name or "").partition(".")[0])


def _fail(text: str, code: int) -> None:
    print(f"hilfit: {text}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
