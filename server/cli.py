"""The ``hilfit`` command: the commands of all packages, errors as one line and an exit code.

Exit codes: 0 done, 1 failed, 2 bad usage or input, 130 interrupted. Every option can be set in the environment:
``--data-dir`` by ``HILFIT_DATA_DIR``. A command's module is imported when the command is used, so that help is quick
and a missing extra costs only the commands that need it.
"""

from __future__ import annotations

import json as json_format
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

#: What typer raises for a command line that it does not understand; only its subclasses are public.
UsageError: Any = typer.BadParameter.__mro__[1]

# All matrices here are small: one BLAS thread is fastest, and has to be asked for before numpy is loaded.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")


@dataclass(frozen=True)
class Part:
    """A module with ``register(app)``, and its commands with the line that stands in the help of ``hilfit``."""

    module: str
    commands: dict[str, str]


#: In the order of the help text.
PARTS = (
    Part("server.demo", {"demo": "The whole job on a simulated machine, from motions to a report."}),
    Part(
        "fitting.cli",
        {
            "identify": "Identify an arm from recordings and find what its model lacks.",
            "effects": "The catalogue of physical effects.",
        },
    ),
    Part("fitting.cli_check", {"check": "Say what may be wrong with recordings and a machine file."}),
    Part("fitting.cli_excite", {"excite": "Design a motion that tells the parameters."}),
    Part(
        "daq.cli",
        {
            "record": "Acquire from a machine's buses and record.",
            "recover": "Seal recordings that a killed recorder left behind.",
            "export": "Write a recording in another format.",
            "import": "Make a recording of another tool's file.",
            "machine": "Look at machine files.",
        },
    ),
    Part("sim_backends.cli", {"simulate": "Run the simulated buses of a machine."}),
    Part("server.bench.cli", {"bench": "Benchmarks with targets: how right, how fast."}),
    Part("server.access.cli", {"access": "Pair devices with a service that has access control."}),
    Part(
        "server.cli_operate",
        {
            "worker": "Take numerical jobs of a service with PostgreSQL.",
            "backup": "Make a backup of a service, running or not.",
            "restore": "Put a backup in the place of what is there.",
        },
    ),
    Part("server.cli", {"serve": "Serve machines, recordings and identifications over HTTP."}),
)
#: Modules that come with an extra of the distribution.
EXTRAS = {"mujoco": "sim", "fsspec": "s3", "s3fs": "s3", "asammdf": "export", "mcap": "export"}


class _Commands(TyperGroup):
    """Shows a line per command, and loads the command itself when it is used."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command in ``args[0]``."""
        for part in PARTS:
            if args and args[0] in part.commands:
                self.commands[args[0]] = load_commands(part)[args[0]]
        return super().resolve_command(ctx, args)


def load_commands(part: Part) -> dict[str, Any]:
    """Import a part; its commands by name."""
    app = typer.Typer()
    app.callback()(lambda: None)  # or a lone command would not be a group
    import_module(part.module).register(app)
    group: Any = typer.main.get_command(app)
    name_environment(group)
    return dict(group.commands)


def build() -> typer.Typer:
    """The command with a line for each of its commands."""
    app = typer.Typer(
        name="hilfit",
        cls=_Commands,
        help="Hardware-in-the-loop acquisition and fitting for hydraulically driven arms.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for part in PARTS:
        for name, text in part.commands.items():
            app.command(name, help=text)(_not_loaded)
    return app


def register(app: typer.Typer) -> None:
    """Add the commands of the service."""
    app.command()(serve)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    try:
        command = typer.main.get_command(build())
        code = command.main(None if arguments is None else list(arguments), prog_name="hilfit", standalone_mode=False)
        sys.exit(code if isinstance(code, int) else 0)
    except UsageError as error:
        place = error.ctx.command_path if error.ctx is not None else "hilfit"
        if type(error).__name__ == "NoArgsIsHelpError":  # nothing was asked: the help is the answer
            error.show()
            sys.exit(2)
        text = " ".join(error.format_message().split()).rstrip(".")
        command_name = place.removeprefix("hilfit").strip()
        _fail(f"{command_name + ': ' if command_name else ''}{text}; see '{place} --help'", 2)
    except typer.Abort:
        sys.exit(130)
    except ModuleNotFoundError as error:
        extra = EXTRAS.get((error.name or "").partition(".")[0])
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
        if parameter.param_type_name == "option" and long and long[0] != "--help":
            parameter.envvar = parameter.envvar or "HILFIT_" + long[0][2:].upper().replace("-", "_")
    for subcommand in getattr(command, "commands", {}).values():
        name_environment(subcommand)


def serve(
    context: typer.Context,
    config: Annotated[Path | None, typer.Option(help="YAML file with settings.", dir_okay=False)] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; others than this computer's need access control.")
    ] = ("127.0.0.1"),
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes a free one.", min=0, max=65535)] = 8350,
    data_dir: Annotated[Path, typer.Option(help="Directory of the database and all files.", file_okay=False)] = Path(
        "hilfit-data"
    ),
    tls_cert: Annotated[
        Path | None, typer.Option(help="Certificate (PEM) to serve HTTPS with.", dir_okay=False)
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(help="Its key (PEM).", dir_okay=False)] = None,
    tls: Annotated[str, typer.Option(help="self-signed: HTTPS with a certificate that the service makes.")] = "off",
    simulate: Annotated[bool, typer.Option(help="Start the simulated machine and acquire from it.")] = False,
    simulation_speed: Annotated[
        float, typer.Option(help="Machine seconds per second of the simulated machine, up to 4.")
    ] = 1.0,
    faults: Annotated[
        Path | None, typer.Option(help="Fault file (YAML): what breaks in the simulated machine, when, for how long.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Serve machines, recordings and identifications over HTTP until stopped."""
    from server.settings import load_settings

    def ready(url: str) -> None:
        print(json_format.dumps({"url": url}) if json else f"hilfit serves on {url} (Ctrl-C stops)", flush=True)

    options: dict[str, Any] = {
        "host": host,
        "port": port,
        "data_dir": data_dir,
        "tls_cert": tls_cert,
        "tls_key": tls_key,
        "tls": tls,
        "simulate": simulate,
        "simulation_speed": simulation_speed,
        "faults": faults,
    }
    settings = load_settings(config, **{name: value for name, value in options.items() if _was_given(context, name)})
    if settings.faults is not None:
        from sim_backends import default_machine
        from sim_backends.cli import checked_faults

        if not settings.simulate:
            from daq.errors import InputError

            raise InputError("--faults: breaks a simulated machine; give --simulate as well")
        checked_faults(settings.faults, default_machine()[0])
    with ExitStack() as stack:
        simulation = None
        if settings.simulate:
            from server.simulation import Simulation

            simulation = stack.enter_context(closing(Simulation(settings.faults)))  # it loads while this process does
        from server.parts import installed_parts
        from server.serve import serve as run

        def parts() -> Any:
            found = installed_parts()
            return found if simulation is None else replace(found, simulation=simulation.machine)

        run(settings, ready, parts)


def _was_given(context: typer.Context, name: str) -> bool:
    """Whether an option was given, here or in the environment: only then it counts more than a configuration file."""
    source = context.get_parameter_source(name)
    return source is not None and not source.name.startswith("DEFAULT")


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


def _not_loaded() -> NoReturn:
    raise AssertionError("a line of the help stands for its command and is replaced by it when it is used")


def _fail(text: str, code: int) -> None:
    print(f"hilfit: {text}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
