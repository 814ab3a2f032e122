"""How fast and how large an identification is, measured on simulated recordings.

Targets: both stages (``identify --no-loop``) on four recordings of 60 s at most 1.5 s of CPU in a process that has
loaded the libraries; with the loop at most 30 s of wall time on two cores; at most 500 MB of memory; cost linear in
samples: a minute added at the end takes at most 1.3 times a minute added at the beginning.

Long recordings are four of 60 s laid end to end, again and again: every motion starts and ends at rest in mid-travel,
so the joints are continuous and noise and disturbance go on. Each length is identified in a process of its own, whose
peak memory the operating system tells (``getrusage``). One hour is the longest by default; ten hours, ``--minutes
10,60,600``, take some ten minutes on a free core and 5 GB for temporary files.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.targets import Check, Outcome, Show, figure, silent
from fitting.arrays import FloatArray
from sim_backends.plant.cases import Case, simulate_case, write_table, write_tables

SHORT = (("unloaded", "unloaded"), ("train", "train-1"), ("repeat", "repeat"), ("validate", "validate"))
MEMORY = 500.0  # MB
MINUTES = (10.0, 30.0, 60.0)
FloatTable = Mapping[str, FloatArray]

# What a child process runs: the request is done once to load everything, and timed the second time.
_CHILD = """
import json, sys, time
from pathlib import Path
from fitting.loop.session import Options, Request
from fitting.pipeline.stages import identify

order = json.loads(sys.argv[1])

def once(name):
    request = Request(
        Path(order["machine"]),
        tuple((role, Path(file)) for role, file in order["recordings"]),
        Path(order["output"]) / name,
        Options(loop=order["loop"]),
    )
    wall, cpu = time.perf_counter(), time.process_time()
    identify(request)
    return time.perf_counter() - wall, time.process_time() - cpu

if order["warm"]:
    once("warm")
wall, cpu = once("timed")
# Of this program alone: what getrusage tells holds the peak of the process that started it.
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
print(json.dumps({"wall": wall, "cpu": cpu, "megabytes": float(status["VmHWM"].split()[0]) / 1024}))
"""


def speed(minutes: Sequence[float] = MINUTES, *, loop: bool = True, show: Show = silent) -> Outcome:
    """Time short recordings with and without the loop, and long ones without it.

    Parameters
    ----------
    minutes : lengths of the training recording, rising; at least two of them to see whether cost is linear
    loop : False leaves the run with the loop out
    show : gets a line for each identification
    """
    checks: list[Check] = []
    with tempfile.TemporaryDirectory(prefix="hilfit-speed-") as name:
        folder = Path(name)
        case = simulate_case("slewing", 1)
        machine = folder / "machine.yaml"
        files = {file.stem: file for _, file in write_tables(folder, case.machine, case.recordings)}
        four = [(role, files[stem]) for role, stem in SHORT]

        def one(what: str, recordings: list[tuple[str, Path]], with_loop: bool, warm: bool) -> dict[str, float]:
            took = identified(machine, recordings, folder / "out", loop=with_loop, warm=warm)
            show(f"{what}: {took['cpu']:.1f} s of CPU, {took['wall']:.1f} s of wall time, {took['megabytes']:.0f} MB")
            return took

        plain = one("four recordings of 60 s, both stages", four, False, True)
        checks.append(_seconds("both stages on four of 60 s, CPU", plain["cpu"], 1.5))
        largest = plain["megabytes"]
        if loop:
            whole = one("the same with the loop", four, True, False)
            checks.append(_seconds("with the loop, wall time", whole["wall"], 30.0))
            largest = max(largest, whole["megabytes"])
        checks.append(memory("four of 60 s", largest))
        times = []
        for length in minutes:
            file = folder / "long.parquet"
            write_table(file, case.machine, "train", _long(case, length))
            recordings = [("unloaded", files["unloaded"]), ("train", file), ("validate", files["validate"])]
            took = one(f"training recording of {length:g} minutes, both stages", recordings, False, False)
            times.append(took["cpu"])
            checks.append(memory(f"{length:g} minutes", took["megabytes"]))
        if len(minutes) > 1:
            checks.append(linear(minutes, times))
    return Outcome(tuple(checks))


def linear(minutes: Sequence[float], times: Sequence[float]) -> Check:
    """Compare the time of a minute added between the last two lengths with that between the first two.

    Two lengths alone have no other stretch to compare: then it is the average over everything, fixed costs included.
    """

    def rate(after: int, before: int) -> float:
        return (times[after] - times[before]) / (minutes[after] - minutes[before])

    last = rate(-1, -2)
    first = rate(1, 0) if len(minutes) > 2 else times[-1] / minutes[-1]
    ratio = last / first
    beside = f"minutes {minutes[0]:g} to {minutes[1]:g}" if len(minutes) > 2 else "the whole on average"
    shown = (
        f"{ratio:.2f} (minutes {minutes[-2]:g} to {minutes[-1]:g} took {60 * last:.1f} s an hour, {beside} "
        f"{60 * first:.1f} s an hour)"
    )
    return figure("cost of the last minutes over the first", ratio, most=1.3, shown=shown)


def _seconds(name: str, value: float, target: float) -> Check:
    return figure(name, value, "{:.2f} s", most=target)


def memory(name: str, value: float) -> Check:
    """Compare peak memory with its target, MB."""
    return figure(f"peak memory, {name}", value, "{:.0f} MB", most=MEMORY)


def identified(
    machine: Path, recordings: list[tuple[str, Path]], output: Path, *, loop: bool, warm: bool
) -> dict[str, float]:
    """Measure s and peak MB of an identification in a process of its own; results in ``output/timed``."""
    order = {
        "machine": str(machine),
        "recordings": [(role, str(file)) for role, file in recordings],
        "output": str(output),
        "loop": loop,
        "warm": warm,
    }
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, json.dumps(order)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    took = json.loads(done.stdout.splitlines()[-1])
    return {key: float(took[key]) for key in ("wall", "cpu", "megabytes")}


def _long(case: Case, minutes: float) -> dict[str, FloatArray]:
    """Lay recordings end to end until they last ``minutes``."""
    stems = ("train-1", "train-2", "validate", "repeat")
    pieces = max(1, round(minutes * 60 / float(case.recordings["train-1"]["time"][-1])))
    return joined([case.recordings[stems[k % len(stems)]] for k in range(pieces)])


def joined(tables: Sequence[FloatTable]) -> dict[str, FloatArray]:
    """Lay recordings end to end, on one clock."""
    names = [name for name in tables[0] if name != "time"]
    whole = {name: np.concatenate([table[name] for table in tables]) for name in names}
    step = float(tables[0]["time"][1] - tables[0]["time"][0])
    return {"time": np.arange(len(whole[names[0]])) * step, **whole}
