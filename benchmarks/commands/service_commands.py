"""Benchmarks of the acquisition and of the service."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from benchmarks.commands.benchmark import benchmark, chosen, rising
from benchmarks.targets import Outcome, Show, together
from daq.errors import InputError

DATABASES: tuple[Literal["sqlite", "postgresql"], ...] = ("sqlite", "postgresql")


@benchmark
def faults(
    show: Show,
    times: Annotated[int, typer.Option(help="That every fault comes.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Of when the faults come and how long they last.")] = 0,
    only: Annotated[str | None, typer.Option(help="Part of a fault's name.")] = None,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="At the wall's clock instead of in lockstep, on a quiet computer.")
    ] = False,
) -> Outcome:
    """Cause every fault at random moments: what is lost, what is wrong, how soon it is over."""
    from benchmarks.acquisition import bus_rows
    from benchmarks.acquisition.faults import names, run

    ours, theirs = names(), bus_rows.names()
    chosen("--only", only, (*ours, *theirs), "is in no fault's name; there are", part=True)
    parts = []
    if only is None or any(only in name for name in ours):
        parts.append(run(times, seed, only, real_time, show))
    if only is None or any(only in name for name in theirs):
        parts.append(bus_rows.run_rows(times, seed, only, show))
    return together(parts)


@benchmark
def channels(
    show: Show,
    machines: Annotated[str, typer.Option(help="Numbers of machines at once, rising, with commas.")] = "1,4,8,12",
    seconds: Annotated[float, typer.Option(help="Length of each run.", min=2)] = 20.0,
) -> Outcome:
    """Count the machines of 40 channels at 50 Hz that one computer carries, and what each costs."""
    from benchmarks.acquisition.channels import run

    return run([int(number) for number in rising("--machines", machines, "1,4,8")], seconds, show)


@benchmark
def soak(
    show: Show,
    minutes: Annotated[float, typer.Option(help="How long.", min=0.5)] = 60.0,
    seed: Annotated[int, typer.Option(help="Of which fault comes when.")] = 0,
) -> Outcome:
    """Cause hours of faults one after another: nothing lost, memory flat."""
    from benchmarks.acquisition.faults import soak as run

    return run(minutes, seed, show)


@benchmark
def service(
    show: Show,
    tablets: Annotated[int, typer.Option(help="Clients of the live stream.", min=1, max=200)] = 20,
    rate: Annotated[float, typer.Option(help="Requests per second.", min=1, max=2000)] = 200.0,
    uploads: Annotated[int, typer.Option(help="Clients that upload recordings all the time.", min=0, max=100)] = 10,
    seconds: Annotated[float, typer.Option(help="Seconds of load.", min=2, max=60)] = 30.0,
    strangers: Annotated[
        int, typer.Option(help="Busy processes of ordinary priority beside all of it.", min=0, max=32)
    ] = 0,
) -> Outcome:
    """Load the service with tablets, readers and uploads while numerical work runs: latency, cycles lost."""
    from benchmarks.service.service import run

    return run(tablets, rate, uploads, seconds, strangers, show)


@benchmark
def page(
    show: Show,
    cpu: Annotated[float, typer.Option(help="How many times slower than this computer the tablet is.", min=1)] = 4.0,
    megabits: Annotated[float, typer.Option(help="Its network, Mbit/s.", min=0.1)] = 10.0,
    times: Annotated[int, typer.Option(help="First views, each with an empty cache.", min=1)] = 5,
    seconds: Annotated[float, typer.Option(help="Seconds of looking at the live view.", min=1)] = 30.0,
    pictures: Annotated[
        Path | None, typer.Option(help="Make pictures of every view in this directory instead.", file_okay=False)
    ] = None,
    only: Annotated[str | None, typer.Option(help="With --pictures: only this view.")] = None,
    language: Annotated[str, typer.Option(help="With --pictures: en or de.")] = "en",
) -> Outcome:
    """Load the page on a slow tablet: first view, frames dropped at 50 Hz; pictures of every view (--pictures)."""
    from benchmarks.page.measuring import LANGUAGES, VIEWS, run
    from benchmarks.page.measuring import pictures as make_pictures
    from benchmarks.page.site import Tablet

    chosen("--only", only, list(VIEWS), "is no view; one of")
    chosen("--language", language, LANGUAGES, "must be one of")
    if pictures is not None:
        return make_pictures(pictures, only, show, language)
    return run(Tablet(cpu, megabits), times, seconds, show)


@benchmark
def storm(
    show: Show,
    seconds: Annotated[float, typer.Option(help="Seconds of killing.", min=2, max=600)] = 60.0,
    database: Annotated[str, typer.Option(help="sqlite, or postgresql (started from Debian's packages).")] = "sqlite",
    seed: Annotated[int, typer.Option(help="Of what is killed when.")] = 0,
    kills_only: Annotated[bool, typer.Option(help="No full disk, no read-only store, no jumps of the clock.")] = False,
    apart: Annotated[bool, typer.Option(help="Workers on hosts that share only PostgreSQL and S3 with it.")] = False,
) -> Outcome:
    """Kill servers, workers, stages and acquisitions with -9: nothing lost, nothing twice."""
    from benchmarks.storm.run import run

    chosen("--database", database, DATABASES, "write one of")
    (kind,) = (known for known in DATABASES if known == database)
    kills = round(seconds * 100 / 60)
    if apart and kind != "postgresql":
        raise InputError("--apart: workers need --database postgresql")
    return run(seconds, kind, seed, show, kills=kills, longest=10 * seconds, faults=not kills_only, apart=apart)


@benchmark
def throughput(
    show: Show,
    workers: Annotated[
        str, typer.Option(help="Numbers of processes that work, the server among them, with commas.")
    ] = "1,2,4",
    jobs: Annotated[int, typer.Option(help="Identifications per worker.", min=1, max=50)] = 4,
) -> Outcome:
    """Measure identifications per hour with several workers on PostgreSQL, and how they share the work."""
    from benchmarks.service.throughput import run

    counts = [int(part) for part in workers.split(",") if part.strip().isdigit()]
    if not counts or min(counts) < 1 or len(counts) != len(workers.split(",")):
        raise InputError(f"--workers {workers}: write numbers from 1 on, as in 1,2,4")
    return run(counts, jobs, show)


@benchmark
def fleet(
    show: Show,
    jobs: Annotated[int, typer.Option(help="Identifications that both workers do; 0: none.", min=0, max=1000)] = 24,
    cut: Annotated[float, typer.Option(help="Seconds that a worker is cut off.", min=1, max=300)] = 60.0,
    every: Annotated[float, typer.Option(help="Seconds between two kills of a worker.", min=5)] = 60.0,
    machines: Annotated[int, typer.Option(help="Recalibrated in one night; 0: none.", min=0, max=1000)] = 1000,
    arms: Annotated[int, typer.Option(help="Different ones among them, all of which are fitted.", min=1)] = 30,
) -> Outcome:
    """Test workers on other hosts with shared database and storage: cut off, killed, a night of recalibrations."""
    from benchmarks.fleet.run import night, run

    parts = [run(jobs, cut, every, show)] if jobs else []
    parts += [night(machines, arms, every, show)] if machines else []
    return together(parts)
