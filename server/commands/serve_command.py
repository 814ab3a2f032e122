"""``hilfit serve``."""

from __future__ import annotations

import json as json_format
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from server.platform.resource import Key
    from server.platform.settings import Settings


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(serve)


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
    base_path: Annotated[str, typer.Option(help="Path of a reverse proxy that all of it stands below.")] = "",
    tls: Annotated[str, typer.Option(help="self-signed: HTTPS with a certificate that the service makes.")] = "off",
    simulate: Annotated[bool, typer.Option(help="Start the simulated machine and acquire from it.")] = False,
    simulation_speed: Annotated[
        float, typer.Option(help="Machine seconds per second of the simulated machine, up to 4.")
    ] = 1.0,
    faults: Annotated[
        Path | None, typer.Option(help="Fault file (YAML): what breaks in the simulated machine, when, for how long.")
    ] = None,
    new_store: Annotated[bool, typer.Option("--new-store", help="Make a new store where there was one.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the address as JSON.")] = False,
) -> None:
    """Serve machines, recordings and identifications over HTTP until stopped."""
    from server.platform.settings import load_settings

    def ready(url: str) -> None:
        print(json_format.dumps({"url": url}) if json else f"hilfit serves on {url} (Ctrl-C stops)", flush=True)

    # All options but two are settings, and only the context knows which were given.
    options = {name: value for name, value in context.params.items() if name not in ("config", "json")}
    settings = load_settings(config, **{name: value for name, value in options.items() if _was_given(context, name)})
    _check_faults(settings)
    with ExitStack() as stack:
        given = _simulated(settings, stack) if settings.simulate else {}
        from server.composition.serve import serve as run

        run(settings, ready, given)
    from server.platform.processes.leaving import leave

    leave()


def _simulated(settings: Settings, stack: ExitStack) -> dict[Key, Any]:
    """Return what a simulated machine gives; it stops with the stack."""
    from server.machines.simulation import Simulation

    simulation = stack.enter_context(closing(Simulation(settings.faults)))  # it loads while this process does
    from server.machines.fault_routes import BREAKABLE
    from server.machines.machine_resource import SIMULATE

    return {SIMULATE: simulation.machine, BREAKABLE: simulation}


def _check_faults(settings: Settings) -> None:
    """Refuse a fault file that the simulated machine cannot follow, or without that machine."""
    if settings.faults is None:
        return
    from sim_backends import default_machine
    from sim_backends.cli import checked_faults

    if not settings.simulate:
        from daq.errors import InputError

        raise InputError("server.faults_without_simulate")
    checked_faults(settings.faults, default_machine()[0])


def _was_given(context: typer.Context, name: str) -> bool:
    """Test whether an option was given, here or in the environment: then it counts more than a configuration file."""
    source = context.get_parameter_source(name)
    return source is not None and not source.name.startswith("DEFAULT")
