"""Time and memory of an identification, on simulated recordings of a minute and of hours.

Targets of ``speed``: both stages (``identify --no-loop``) on four recordings of 60 s at most 1.5 s of CPU in a process
that has loaded the libraries; with the loop at most 30 s of wall time on two cores; at most 500 MB of memory; cost
linear in samples: a minute added at the end takes at most 1.3 times a minute added at the beginning. Its long
recordings are four of 60 s laid end to end, again and again: every motion starts and ends at rest in mid-travel, so the
joints are continuous and noise and disturbance go on. Each length is identified in a process of its own, whose peak
memory the operating system counts. One hour is the longest by default; ten hours, ``--minutes 10,60,600``, take some
ten minutes on a free core and 5 GB for temporary files.

In ``long``, with the loop, every stretch of ten minutes is a motion of its own with noise of its own, so hours hold as
much information as they seem to. Planted is friction of one cylinder that depends on its piston's position, all the
time; or a mass that the arm picks up after seven twelfths of the recording and keeps. Targets: memory and cost as
above; the planted effect is named, or in the set, and nothing else; the moment is right to two minutes; errors on
`validate` fall.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.samples import named
from benchmarks.targets import Check, Outcome, Show, figure
from fitting.arrays import FloatArray
from sim_backends.plant.cases import Case, CasePlan, plan_case, simulate_case, write_table, write_tables
from sim_backends.plant.motion import random_motion
from sim_backends.plant.plant import record_beside_ideal
from sim_backends.undeclared import EffectSpec

SHORT = (("unloaded", "unloaded"), ("train", "train-1"), ("repeat", "repeat"), ("validate", "validate"))
MEMORY = 500.0  # MB
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


def speed(minutes: Sequence[float], *, loop: bool, show: Show) -> Outcome:
    """Time short recordings with and without the loop, and long ones without it."""
    checks: list[Check] = []
    with tempfile.TemporaryDirectory(prefix="hilfit-speed-") as name:
        folder = Path(name)
        case = simulate_case("slewing", 1)
        machine = folder / "machine.yaml"
        files = {file.stem: file for _, file in write_tables(folder, case.machine, case.recordings)}
        four = [(role, files[stem]) for role, stem in SHORT]

        def one(what: str, recordings: list[tuple[str, Path]], with_loop: bool, warm: bool) -> dict[str, float]:
            took = _identified(machine, recordings, folder / "out", loop=with_loop, warm=warm)
            show(f"{what}: {took['cpu']:.1f} s of CPU, {took['wall']:.1f} s of wall time, {took['megabytes']:.0f} MB")
            return took

        plain = one("four recordings of 60 s, both stages", four, False, True)
        checks.append(figure("both stages on four of 60 s, CPU", plain["cpu"], "{:.2f} s", most=1.5))
        largest = plain["megabytes"]
        if loop:
            whole = one("the same with the loop", four, True, False)
            checks.append(figure("with the loop, wall time", whole["wall"], "{:.2f} s", most=30.0))
            largest = max(largest, whole["megabytes"])
        checks.append(_memory("four of 60 s", largest))
        times = []
        for length in minutes:
            file = folder / "long.parquet"
            write_table(file, case.machine, "train", _long(case, length))
            recordings = [("unloaded", files["unloaded"]), ("train", file), ("validate", files["validate"])]
            took = one(f"training recording of {length:g} minutes, both stages", recordings, False, False)
            times.append(took["cpu"])
            checks.append(_memory(f"{length:g} minutes", took["megabytes"]))
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


def _memory(name: str, value: float) -> Check:
    """Compare peak memory with its target, MB."""
    return figure(f"peak memory, {name}", value, "{:.0f} MB", most=MEMORY)


def _identified(
    machine: Path, recordings: list[tuple[str, Path]], output: Path, *, loop: bool, warm: bool
) -> dict[str, float]:
    """Measure s and peak MB of an identification in a process of its own; results in ``output/timed``."""
    files = [(role, str(file)) for role, file in recordings]
    order = {"machine": str(machine), "recordings": files, "output": str(output), "loop": loop, "warm": warm}
    command = [sys.executable, "-c", _CHILD, json.dumps(order)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment)
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


#: Length of the stretches that recordings are made of, s; of `validate`, min; and when the payload comes, share.
_STRETCH, _VALIDATE, _PICKED_UP = 600.0, 10.0, 7.0 / 12.0
FRICTION = EffectSpec("position_dependent_friction", "joint2", 75.0)
PAYLOAD = EffectSpec("payload", None, 5.0)
#: s by which the moment of a change may be off: pieces are half a minute long.
_MOMENT = 120.0


def long(minutes: Sequence[float], effect_minutes: float, *, seed: int, show: Show) -> Outcome:
    """Identify long recordings with the loop."""
    checks: list[Check] = []
    with tempfile.TemporaryDirectory(prefix="hilfit-long-") as name:
        folder = Path(name)
        plan = plan_case("slewing", seed)

        def one(what: str, train: FloatTable, also: Sequence[EffectSpec]) -> tuple[dict[str, float], dict[str, Any]]:
            tables = {
                "unloaded": _record(plan, plan.motions["unloaded"].duration, also, 1000, unloaded=True),
                "train": train,
                "validate": joined([_record(plan, _STRETCH, also, 2000 + k) for k in range(round(_VALIDATE / 10))]),
            }
            files = write_tables(folder, plan.machine, tables)
            took = _identified(folder / "machine.yaml", files, folder / "out", loop=True, warm=False)
            report = json.loads((folder / "out" / "timed" / "report.json").read_text(encoding="utf-8"))
            show(f"{what}: {took['cpu']:.0f} s of CPU, {took['megabytes']:.0f} MB; {_found(report)}")
            checks.append(_memory(what, took["megabytes"]))
            return took, report

        times = []
        for length in minutes:
            took, report = one(f"{length:g} minutes with {FRICTION.id}", _training(plan, length, FRICTION), [FRICTION])
            times.append(took["cpu"])
            checks += _named(report, f"{length:g} minutes", FRICTION)
        if len(minutes) > 1:
            checks.append(linear(minutes, times))
        if effect_minutes:
            what = f"{effect_minutes:g} minutes with a payload"
            _, report = one(what, picked_up(plan, effect_minutes), [])
            checks += _named(report, f"{effect_minutes:g} minutes", PAYLOAD)
            checks.append(_moment(report, 60.0 * effect_minutes * _PICKED_UP))
    return Outcome(tuple(checks))


def _record(
    plan: CasePlan, seconds: float, effects: Sequence[EffectSpec], number: int, *, unloaded: bool = False
) -> dict[str, FloatArray]:
    """Record a motion of its own, with noise of its own; ``number`` distinguishes them."""
    drawn, noise, shapes = (np.random.default_rng([plan.seed, *own]) for own in ((60, number), (50, number), (13,)))
    motion = random_motion(plan.machine, drawn, seconds, rods="unpinned" if unloaded else "pinned")
    return record_beside_ideal(plan.machine, plan.truth, motion, undeclared=effects, rng=noise, shapes=shapes)[0]


def _training(plan: CasePlan, minutes: float, *effects: EffectSpec) -> FloatTable:
    """Make a training recording of so many minutes."""
    count = max(1, round(minutes * 60.0 / _STRETCH))
    return joined([_record(plan, minutes * 60.0 / count, effects, k) for k in range(count)])


def picked_up(plan: CasePlan, minutes: float) -> FloatTable:
    """Make a training recording in which a payload comes, else one motion: the plant picks up once in each."""
    before = _training(plan, minutes * _PICKED_UP)
    return joined([before, _record(plan, 60.0 * minutes * (1 - _PICKED_UP), [PAYLOAD], 500)])


def _found(report: Mapping[str, Any]) -> str:
    overall, loop = report["overall"], report["loop"]
    names = [f"{e['id']} ({e['joint'] or 'machine'})" for e in loop["effects"]]
    names += [f"a law of {law['variable']} ({law['joint']})" for law in loop["unexplained"]]
    change = f"{overall['before']:.2f} to {overall['after']:.2f} noise floors on {overall['role']}"
    return f"{', '.join(names) or 'nothing'}; {change}"


def _named(report: Mapping[str, Any], what: str, effect: EffectSpec) -> list[Check]:
    """Check that the effect, and nothing else, was named or is in the set; and its gain on `validate`."""
    found = report["loop"]["effects"]
    right = any((effect.id, effect.joint) in own for own in named(report))
    surplus = len(found) + len(report["loop"]["unexplained"]) - int(right)
    change = report["overall"]["change_percent"]
    return [
        Check(f"{what}, effect named or in the set", float(right), _found(report), "at least", 1.0, "named"),
        Check(f"{what}, effects that are not there", float(surplus), f"{surplus}", "at most", 0.0, "none"),
        Check(f"{what}, error on validate", change, f"{change:+.1f} %", "at most", 0.0, "not higher"),
    ]


def _moment(report: Mapping[str, Any], true: float) -> Check:
    """Check the moment of the payload against the true one, which lies 15 to 35 s after ``true``."""
    moments = [e["parameters"]["t_0"]["value"] for e in report["loop"]["effects"] if e["id"] == PAYLOAD.id]
    off = min((abs(moment - true - 25.0) for moment in moments), default=float("inf"))
    return figure("moment of the payload", off, "{:g} s", most=_MOMENT, shown=f"{off:.0f} s off")
