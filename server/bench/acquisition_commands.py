"""``hilfit bench faults``, ``soak`` and ``channels``: the commands of the benchmarks of acquisition."""

from __future__ import annotations

from typing import Annotated

import typer


def faults(
    times: Annotated[int, typer.Option(help="That every fault comes.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Of when the faults come and how long they last.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a fault's name.")] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="At the wall's clock instead of in lockstep, on a quiet computer.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the checks as JSON.")] = False,
) -> None:
    """Every fault at random moments: what is lost, what is wrong, how soon it is over."""
    from daq.errors import InputError
    from server.bench.cli import _finish, _shown
    from server.bench.faults import run, scripts

    if only is not None and not any(only in name for name, _ in scripts()):
        raise InputError(f"--only {only}: is in no fault's name; there are {', '.join(name for name, _ in scripts())}")
    _finish("faults", run(times, seed, only, real_time, _shown(json)), json)
