"""The monitor of valves on simulated machines: quiet while they are healthy, and what it reports of changes.

Each machine is identified by its own recordings. Then it works for long, its usual numbers are learnt and watched on;
and once more it works after one change to the first of its axes, of which the monitor is not informed. It is fed rows
as a ring buffer has them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.cases import append
from benchmarks.targets import Check, Outcome, Show, figure, rate, silent
from benchmarks.valve.drawing import ValveKey, order_of
from daq.frames.frame import row_dtype
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import read_recording
from fitting.valve.identify import identify_valves
from server.monitor.followed import Speeds
from server.monitor.monitor_child import watch
from server.monitor.monitor_order import Order, Rules
from server.monitor.residual_blocks import Windows
from sim_backends.valve.effects import ValveEffectSpec, with_effect
from sim_backends.valve.motion import working_motion
from sim_backends.valve.recording import Run, recorded, run_all, simulate_valve_case, write_valve_case
from sim_backends.valve.truth import ValvePlantTruth

#: s of each motion, how many of them while healthy, and after each change.
SECONDS, HEALTHY, CHANGED = 150.0, 12, 2
#: What happens to the first axis: name, form and size of an effect.
CHANGES = (("edge_wear", "shifted", 0.02), ("slower_spool", "pilot", 0.3), ("null_shift", "spring", 0.015))
Found = dict[str, Any]


#: Rows of one motion as a ring buffer has them.
Rows = np.ndarray[Any, Any]


def _watched(folder: Path, key: ValveKey) -> Found:
    """Monitor one machine; ``folder`` is for its files."""
    machine, truth, programmes, guesses, effects, quality, noise = order_of(key)
    case = simulate_valve_case(machine, truth, programmes, guesses, effects=effects, quality=quality, seed=noise)
    write_valve_case(folder, case)
    machine = load_machine(folder / "machine.yaml")
    train = [read_recording(path, machine, "train") for path in sorted(folder.glob("train-*.parquet"))]
    judged = [read_recording(folder / "validate.parquet", machine, "validate")]
    (folder / "valve.json").write_text(json.dumps(identify_valves(machine, train, judged).report), encoding="utf-8")
    work = list(_worked(key))
    healthy = _monitored(folder, machine, [rows for change, rows in work if not change])
    drifting = np.array([False, *(bool(one["drifting"]) for one in healthy)])
    alarms = int(np.count_nonzero(drifting[1:] & ~drifting[:-1]))
    found: Found = {"case": key.text, "blocks": len(healthy), "alarms": alarms, "changes": []}
    memory = (folder / "memory.json").read_bytes()
    for name, form, size in CHANGES:
        (folder / "memory.json").write_bytes(memory)  # a change is watched from where the healthy machine stood
        reports = _monitored(folder, machine, [rows for change, rows in work if change == name])
        first = next((number for number, one in enumerate(reports, 1) if one["drifting"]), None)
        last = next(own for own in reports[-1]["joints"] if own["joint"] == machine.joints[0].name)
        spec = ValveEffectSpec(name, form, machine.joints[0].name, size)
        found["changes"].append(
            {"change": name, "blocks": first, "axes": sorted({axis for one in reports for axis in one["drifting"]}),
             "moved": last.get("moved", []), "true": _true(truth, with_effect(machine, truth, spec), spec)}
        )  # fmt: skip
    return found


def _worked(key: ValveKey) -> Iterator[tuple[str, Rows]]:
    """Let a machine work: after which change, if any, and the rows of each motion."""
    machine, truth, _, guesses, _, quality, noise = order_of(key)
    runs, changes = list[Run](), list[str]()
    for number, (name, form, size) in enumerate((("", "", 0.0), *CHANGES)):
        spec = ValveEffectSpec(name, form, machine.joints[0].name, size)
        now = with_effect(machine, truth, spec) if name else truth
        for part in range(CHANGED if name else HEALTHY):
            rng = np.random.default_rng([80, key.seed, key.number, number, part])
            phases = working_motion(guesses, rng, SECONDS, float(rng.uniform(0.5, 0.8)))
            late = 600.0 + 200.0 * (part + HEALTHY * bool(name))
            runs.append(Run(machine, now, phases, guesses, power_on=late, noise=(noise, 53, number, part)))
            changes.append(name)
    names = [channel.name for channel in machine.channels]
    for place, (course, change) in enumerate(zip(run_all(runs), changes, strict=True)):
        table = recorded(machine, course, quality, np.random.default_rng([noise, 54, place]))  # type: ignore[arg-type]
        rows = np.zeros(len(course.time), dtype=row_dtype(len(names)))
        rows["time"], rows["values"] = course.time, np.column_stack([table[name] for name in names])
        yield change, rows


def _monitored(folder: Path, machine: Machine, several: Sequence[Rows]) -> list[Mapping[str, Any]]:
    """Monitor each block; between motions rows are missing."""
    rules = Rules()
    order = Order("valves", folder / "valve.json", folder / "machine.yaml", "", folder / "memory.json", rules)
    followed = Speeds(order.model, machine, rules)
    cutter = Windows(followed.overlap, followed.block_samples(rules.block_s))
    windows = (window for rows in several for window in cutter.push(rows, missed=1))
    reports = list[Mapping[str, Any]]()
    watch(followed, tuple(channel.name for channel in machine.channels), order, windows, reports.append)
    return reports


def _true(healthy: ValvePlantTruth, changed: ValvePlantTruth, spec: ValveEffectSpec) -> dict[str, float]:
    """Compute by how much edges and delays have moved, as far as they have."""
    joint = str(spec.joint)
    moved = dict[str, float]()
    for way, name, sign in (("extend", "head_in", 1.0), ("retract", "rod_in", -1.0)):
        valves = [truth.valves[joint] for truth in (healthy, changed)]
        edges = [valve.lands[name].edge - sign * valve.spool.null for valve in valves]
        moved[f"edge.{way}"] = edges[1] - edges[0]
        moved[f"delay.{way}"] = valves[1].spool.lateness - valves[0].spool.lateness
    return {name: value for name, value in moved.items() if value}


def _checks(found: Sequence[Found], show: Show) -> list[Check]:
    """Check rates and figures of a run."""
    right, named, errors = 0, 0, list[float]()
    changes = [(one["case"], own) for one in found for own in one["changes"]]
    for case, own in changes:
        moved = {number["name"]: number["value"] for number in own["moved"]}
        right += len(own["axes"]) == 1 and own["blocks"] is not None
        named += set(own["true"]) <= set(moved)
        errors += [moved[name] / true - 1.0 for name, true in own["true"].items() if name in moved]
        by, true = (", ".join(f"{k} {v:+.4f}" for k, v in numbers.items()) for numbers in (moved, own["true"]))
        show(f"{case}: {own['change']}: after {own['blocks']} blocks at {', '.join(own['axes'])}: {by} (true {true})")
    blocks = sum(one["blocks"] for one in found)
    waited = [own["blocks"] for _, own in changes if own["blocks"] is not None]
    off = 100.0 * float(np.quantile(np.abs(errors or [0.0]), 0.9))
    return [
        figure(f"alarms in {blocks} blocks of healthy machines", sum(one["alarms"] for one in found), "{}", most=0),
        rate("changes that raised an alarm at their axis alone", right, len(changes), "at least", 0.9),
        rate("of these all numbers that moved are named", named, len(changes)),
        figure("blocks of 2 s until the alarm, largest", max(waited, default=0), "{}"),
        figure("error of what is said to have moved, p90", off, "{:.0f} %"),
    ]


def run(count: int, seed: int, output: Path | None, show: Show) -> Outcome:
    """Monitor ``count`` machines, one after another; append each one's numbers to ``output``."""
    found = list[Found]()
    for number in range(count):
        with TemporaryDirectory() as temporary:
            found.append(_watched(Path(temporary), ValveKey(number, "null", seed)))
        append(output, found[-1])
        _checks(found[-1:], show)
    return Outcome(tuple(_checks(found, silent)), ("",), {"machines": found})
