"""Answers beside what is true: a line per case, paths followed through inverses, and rates with their targets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.targets import Check, figure, rate
from benchmarks.valve.drawing import ValveKey, order_of
from benchmarks.valve.judging import WAYS, Answer, AxisAnswer, Bar
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import read_recording
from fitting.arrays import FloatArray
from sim_backends.valve.motion import Follow, working_motion
from sim_backends.valve.tracking import Control, Inverse, Pressures, TrueInverse, linear_inverse, track
from sim_backends.valve.truth import ValvePlantTruth, load_valve_truth

#: Error of the healthy law over the speed's root mean square from which an effect is large, and share of the time for
#: which a pump's limit is reached while all axes move.
LARGE, OFTEN = 0.03, 0.02
#: Of the speed at the largest command: where an edge is compared.
EDGE_SPEED = 0.02
POINTS = 400  # of an axis, at which an inverse is asked
CURVE = "curve_"  # what names of curves begin with: a shape of the valve, no effect
Line = dict[str, Any]


def scored(folder: Path, answer: Answer) -> Line:
    """Score one case: what was found, and what is true."""
    machine, truth = load_machine(folder / "machine.yaml"), load_valve_truth(folder / "truth.yaml")
    case = yaml.safe_load((folder / "case.yaml").read_text(encoding="utf-8"))
    effects = yaml.safe_load((folder / "truth.yaml").read_text(encoding="utf-8"))["effects"]
    limit = truth.supply.flow_limit
    limited = bool(np.isfinite([limit, truth.supply.power_limit]).any())
    axes = {}
    for name, axis in answer.axes.items():
        true = [e["id"] for e in effects if e["joint"] == name] + ["pump_flow_limit"] * limited
        axes[name] = {
            "error": axis.error,
            "floor": case["floor"][name],
            "seen": case["seen"][name],
            "named": [list(found) for found in axis.effects if not found[0].startswith(CURVE)],
            "laws": list(axis.laws),
            "true": true,
            "delay": _beside(axis.delay, truth.valves[name].spool.lateness),
            "edges": {w: _beside(axis.edges[w], true_edge(truth, name, w, axis.largest[w])) for w in axis.edges},
            "flow_limit": axis.flow_limit,
            "command_errors": command_errors(folder, machine, truth, name, axis) if case["made"] == "null" else [],
        }
    return {
        "case": folder.name, "kind": case["kind"], "made": case["made"], "at_limit": case["at_limit"],
        "effects": effects, "flow_limit": limit if np.isfinite(limit) else None, "axes": axes,
        "seconds": answer.seconds,
    }  # fmt: skip


def true_edge(truth: ValvePlantTruth, joint: str, way: str, largest: float) -> float:
    """Compute the command (fraction of full) for 2 % of the speed at the ``largest``, at equal pressures."""
    land = truth.valves[joint].lands["head_in" if way == "extend" else "rod_in"]
    opening = (max(largest - land.edge, 0.0) / (1.0 - land.edge)) ** land.exponent
    opening /= (1.0 + (opening / land.saturation) ** 4) ** 0.25
    wanted = EDGE_SPEED * opening
    wanted /= (1.0 - (wanted / land.saturation) ** 4) ** 0.25
    return float(land.edge + (1.0 - land.edge) * wanted ** (1.0 / land.exponent))


def command_errors(folder: Path, machine: Machine, truth: ValvePlantTruth, joint: str, axis: AxisAnswer) -> list[float]:
    """Compute the inverse's command less the true one, fractions of full, along the motion of ``validate``.

    At measured pressures and speeds of the motion above 5 % of full, within the commands that were recorded.
    """
    if axis.command is None:
        return []
    recording = read_recording(folder / "validate.parquet", machine, "validate")
    number = [own.name for own in machine.joints].index(joint)
    cylinder = machine.joints[number].cylinder
    assert cylinder is not None

    def values(quantity: str, of: str | None = None) -> np.ndarray | None:
        channel = machine.channel(quantity, of)
        return None if channel is None else np.asarray(recording.values[channel.name])

    x = values("piston_position", joint)
    if x is None:
        angle = values("joint_position", joint)
        assert angle is not None
        x = cylinder.linkage.piston_position(angle)
    speed = np.gradient(np.convolve(x, np.ones(9) / 9, mode="same"), 1.0 / recording.rate_hz)
    head, rod = values("head_pressure", joint), values("rod_pressure", joint)
    supply, tank = values("supply_pressure"), values("tank_pressure")
    assert head is not None and rod is not None and supply is not None and tank is not None
    inverse = TrueInverse(machine, truth, trusting=False)
    errors = []
    for k in np.linspace(50, len(x) - 51, POINTS).astype(int):
        wished = np.zeros(len(machine.joints))
        wished[number] = speed[k]
        full = truth.valves[joint].lands["head_in"].flow / cylinder.head_area
        drop = supply[k] - (head if speed[k] > 0 else rod)[k]
        if abs(speed[k]) < 0.05 * full or drop < 3.0e5:
            continue
        chambers = np.full(len(wished), head[k]), np.full(len(wished), rod[k])
        pressures = Pressures(*chambers, supply=float(supply[k]), tank=float(tank[k]))
        true = float(inverse(wished, pressures)[number])
        if 0.0 < abs(true) <= axis.largest[WAYS[0 if true > 0 else 1]]:
            command = axis.command(float(speed[k]), head[k], rod[k], supply[k], tank[k], True)
            errors.append(abs(command - true))
    return errors


def _beside(bar: Bar, true: float) -> dict[str, Any]:
    value, interval = bar
    return {"value": value, "true": true, "in": None if interval is None else interval[0] <= true <= interval[1]}


def _axes(lines: Sequence[Line], made: str | None = None) -> Iterator[Mapping[str, Any]]:
    return (axis for line in lines if made in (None, line["made"]) for axis in line["axes"].values())


def named(line: Line) -> bool:
    """Test whether the effect of a case is named, or in a set, at its joint (of the whole machine: any)."""
    effect = line["effects"][0]
    places = [effect["joint"]] if effect["joint"] else list(line["axes"])
    return any(effect["id"] in found for place in places for found in line["axes"][place]["named"])


def large(line: Line) -> bool:
    """Test whether the effect of a case is visible enough to be counted."""
    if not line["effects"]:
        return False
    joint = line["effects"][0]["joint"]
    return bool(line["at_limit"] >= OFTEN if joint is None else line["axes"][joint]["seen"] >= LARGE)


def checks(lines: Sequence[Line]) -> list[Check]:
    """Check rates and figures of a run against the targets."""
    healthy = list(_axes(lines, "null"))
    result: list[Check] = []
    ratios = [axis["error"] / axis["floor"] for axis in healthy]
    if ratios:
        middle, most = float(np.median(ratios)), float(np.quantile(ratios, 0.9))
        shown = f"{middle:.2f} (nine of ten below {most:.2f})"
        result.append(figure("held-out error of null over noise floor, median", middle, most=1.3, shown=shown))
    wrong = [axis for axis in healthy if any(not set(found) & set(axis["true"]) for found in axis["named"])]
    result.append(rate("null: an effect named that is not there", len(wrong), len(healthy), "at most", 0.02))
    laws = sum(bool(axis["laws"]) for axis in healthy)
    result.append(rate("null: a law of an unknown effect that is not there", laws, len(healthy)))
    counted = [line for line in lines if large(line)]
    result.append(rate("large: named, or in a set", sum(map(named, counted)), len(counted), "at least", 0.90))
    inside = [own["in"] for axis in healthy for own in axis["edges"].values() if own["in"] is not None]
    result += _covered("edges", inside)
    result += _covered("delays", [axis["delay"]["in"] for axis in healthy if axis["delay"]["in"] is not None])
    errors = [error for axis in healthy for error in axis["command_errors"]]
    if errors:
        result.append(figure("command error of the inverse, p95 of full", float(np.quantile(errors, 0.95)), "{:.4f}",
                             most=0.012))  # fmt: skip
    limits = [
        max((abs(axis["flow_limit"] / line["flow_limit"] - 1.0) for axis in line["axes"].values()
             if axis["flow_limit"] is not None), default=None)
        for line in lines
        if line["flow_limit"] is not None and line["at_limit"] >= OFTEN
    ]  # fmt: skip
    found = [own for own in limits if own is not None]
    result.append(rate("pump's flow limit: found where it is reached", len(found), len(limits)))
    if found:
        result.append(figure("pump's flow limit, largest error", 100.0 * max(found), "{:.1f} %", most=5.0))
    return result


def _covered(what: str, inside: Sequence[bool]) -> list[Check]:
    name = f"{what} in their 95 % bars"
    return [
        rate(f"{name}: at least", sum(inside), len(inside), "at least", 0.90),
        rate(f"{name}: at most", sum(inside), len(inside), "at most", 0.98),
    ]


def case_text(line: Line) -> str:
    """Write one line for the terminal."""
    parts = []
    for name, axis in line["axes"].items():
        names = ", ".join("|".join(found) for found in axis["named"]) or "nothing"
        parts.append(f"{name} {axis['error']:.3f}/{axis['floor']:.3f} {names}")
    true = ", ".join(f"{e['id']} ({e['form']}) at {e['joint'] or 'all'}" for e in line["effects"]) or "nothing"
    return f"{line['case']}: {true}: " + "; ".join(parts)


SECONDS = 30.0
CALM = 0.5  # of the travel, or of the speed
POWER_ON = 1000.0  # s: later than any recording
PRESSURE_NOISE = 2.0e4  # Pa
HALF_A_CYCLE = 0.01  # s for which a command is older than when it was sent, on the average


def inverse_of(answer: Answer) -> Inverse:
    """Combine all axes' inverses; an axis ordered to rest does so until it is asked for enough."""
    axes = list(answer.axes.values())
    moving = [False] * len(axes)

    def inverse(speed: FloatArray, p: Pressures) -> FloatArray:
        commands = np.zeros(len(axes))
        for j, axis in enumerate(axes):
            assert axis.command is not None
            commands[j] = axis.command(float(speed[j]), float(p.head[j]), float(p.rod[j]), p.supply, p.tank, moving[j])
            moving[j] = commands[j] != 0.0
        return commands

    return inverse


def followed(folder: Path, key: ValveKey, answer: Answer) -> dict[str, Any]:
    """Measure tracking errors (RMS of all axes, over travel) of one feedback with four feedforwards."""
    machine, truth = load_machine(folder / "machine.yaml"), load_valve_truth(folder / "truth.yaml")
    guesses = order_of(key)[3]
    rng = np.random.default_rng([80, key.seed, key.number])
    path = next(p.path for p in working_motion(guesses, rng, SECONDS, CALM) if isinstance(p, Follow))
    linear, late = linear_inverse(guesses), np.array([axis.delay[0] + HALF_A_CYCLE for axis in answer.axes.values()])
    ways = {
        "feedback": Control(linear, feedforward=False),
        "linear": Control(linear),
        "inverse": Control(inverse_of(answer)),
        "preview": Control(inverse_of(answer), preview=late),
    }
    tracked = track(machine, truth, path, list(ways.values()), power_on=POWER_ON, pressure_std=PRESSURE_NOISE, rng=rng)
    travel = np.array([guess.high - guess.low for guess in guesses])
    return {way: float(np.sqrt(((rms / travel) ** 2).mean())) for way, rms in zip(ways, tracked, strict=True)}
