"""The ``hilfit`` command: the commands of all packages, errors as one line and an exit code.

Exit codes: 0 done, 1 failed, 2 bad usage or input, 130 interrupted. Every option can be set in the environment
(:mod:`server.commands.conventions`). A command's module is imported when the command is used, so that help is quick
and a missing extra costs only the commands that need it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points, version
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from server.commands import conventions

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
    Part("server.commands.demo_command", {"demo": "The whole job on a simulated machine, from motions to a report."}),
    Part(
        "fitting.commands.identify_command",
        {
            "identify": "Identify an arm from recordings and find what its model lacks.",
            "effects": "The catalogue of physical effects.",
        },
    ),
    Part(
        "fitting.commands.valve_command", {"valve": "What speed a valve's command gives, and the command for a speed."}
    ),
    Part(
        "fitting.model.cli",
        {
            "predict": "Predict the efforts in a recording by a model.",
            "compare": "Two models on one recording: which predicts it better.",
            "model": "Look at a model, and export it.",
            "feedforward": "Efforts and pressures that a motion takes, for the arm's controller.",
            "energy": "Work of the drives in a motion or a recording.",
            "overload": "Collisions and overloads in a recording.",
            "payload": "The mass at the tip over a recording.",
        },
    ),
    Part("fitting.commands.check_command", {"check": "Say what may be wrong with recordings and a machine file."}),
    Part("fitting.commands.excite_command", {"excite": "Design a motion that tells the parameters."}),
    Part(
        "fitting.commands.valve_motion_command",
        {"valve-motion": "Plan commands for the arm's controller that show its valves."},
    ),
    Part(
        "daq.commands.cli",
        {
            "record": "Acquire from a machine's buses and record.",
            "replay": "Make a recording from a raw trace of CAN buses.",
            "recover": "Seal recordings that a killed recorder left behind.",
            "export": "Write a recording in another format.",
            "import": "Make a recording of another tool's file.",
            "machine": "Look at machine files.",
            "bus": "Look after the devices of a machine's buses.",
        },
    ),
    Part("sim_backends.cli", {"simulate": "Run the simulated buses of a machine."}),
    Part(
        "server.commands.operate_commands",
        {
            "access": "Pair devices with a service that has access control.",
            "worker": "Take numerical jobs of a service with PostgreSQL.",
            "backup": "Make a backup of a service, running or not.",
            "restore": "Put a backup in the place of what is there.",
        },
    ),
    Part("server.commands.serve_command", {"serve": "Serve machines, recordings and identifications over HTTP."}),
    Part("server.commands.doctor_command", {"doctor": "Say whether this computer is ready, and what to do if not."}),
)
#: Entry points of other distributions that add a command: its name, and a module with ``register(app)``.
ENTRY_POINT_GROUP = "hilfit.commands"
#: Modules that come with an extra of the distribution.
EXTRAS = {"mujoco": "sim", "fsspec": "s3", "s3fs": "s3", "asammdf": "export", "mcap": "export", "cantools": "dbc"}


class _Commands(TyperGroup):
    """Shows a line per command, and loads the command itself when it is used."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command in ``args[0]``."""
        for part in all_parts():
            if args and args[0] in part.commands:
                self.commands[args[0]] = load_commands(part)[args[0]]
                for words, own in conventions.walk(self.commands[args[0]], args[0]):
                    conventions.refuse_old_names(words, own)
        return super().resolve_command(ctx, args)


def all_parts() -> tuple[Part, ...]:
    """List the parts of hilfit, then those of other distributions, with their summary as help.

    A name that hilfit has cannot be taken.
    """
    own = {name for part in PARTS for name in part.commands}
    others = [point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name not in own]
    return PARTS + tuple(
        Part(point.value, {point.name: point.dist.metadata["Summary"] if point.dist else ""})
        for point in sorted(others, key=lambda point: point.name)
    )


def load_commands(part: Part) -> dict[str, Any]:
    """Import a part; its commands by name."""
    app = typer.Typer()
    app.callback()(lambda: None)  # or a lone command would not be a group
    import_module(part.module).register(app)
    group: Any = typer.main.get_command(app)
    conventions.apply(group)
    return dict(group.commands)


def every_command() -> Iterator[tuple[str, Any]]:
    """Yield every command with its words after ``hilfit``, in the help's order, but for those without an extra."""
    for part in all_parts():
        try:
            loaded = load_commands(part)
        except ModuleNotFoundError:
            continue
        for name, command in loaded.items():
            yield from conventions.walk(command, name)


def build() -> typer.Typer:
    """Build the command with a line for each of its commands."""
    app = typer.Typer(
        name="hilfit",
        cls=_Commands,
        help="Hardware-in-the-loop acquisition and fitting for hydraulically driven arms.",
        no_args_is_help=True,
        add_completion=True,  # --install-completion for the shell that is used, --show-completion
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_root)
    for part in all_parts():
        for name, text in part.commands.items():
            app.command(name, help=text)(_not_loaded)
    return app


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


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"hilfit {version('hilfit')}")
        raise typer.Exit


def _root(
    show_version: Annotated[
        bool, typer.Option("-V", "--version", help="Print the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Take options of the command itself."""


def _not_loaded() -> NoReturn:
    raise AssertionError("a line of the help stands for its command and is replaced by it when it is used")


def _fail(text: str, code: int) -> None:
    print(f"hilfit: {text}", file=sys.stderr)
    sys.exit(code)


if __name__ == "__main__":
    main()
