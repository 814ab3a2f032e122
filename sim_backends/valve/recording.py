"""Programmes run on valve plants, and what the transducers record of them: cases on disk with their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.cases import write_tables
from sim_backends.plant.sensors import SensorChain
from sim_backends.plant.truth import SensorQuality
from sim_backends.valve.effects import ValveEffectSpec, with_effect
from sim_backends.valve.motion import Guess, Operator, Phase
from sim_backends.valve.plant import STEP, ValvePlant
from sim_backends.valve.truth import ValvePlantTruth

COMMAND_STEPS = 1000  # of the amplifier's resolution, over full


@dataclass(frozen=True)
class Run:
    """Order of a recording: a machine with its truth, what its controller does, and when.

    ``power_on`` is the time in s for which the machine has run before; ``start`` are fractions of the travel; ``noise``
    seeds what is restless.
    """

    machine: Machine
    truth: ValvePlantTruth
    phases: Sequence[Phase]
    guesses: Sequence[Guess]
    power_on: float = 0.0
    start: tuple[float, ...] = ()
    noise: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Course:
    """True course of a run, at every cycle ``k`` of the controller; commands are in force from then on.

    Attributes
    ----------
    time : (N,) s since the run began
    command : (N, J) fraction of full, as the amplifier resolves it
    q, x, v, stroke : (N, J) rad or m, m, m/s, fraction of full
    pressure : (N, 2, J) Pa, head and rod
    supply, tank, temperature : (N,) Pa, Pa, K
    """

    time: FloatArray
    command: FloatArray
    q: FloatArray
    x: FloatArray
    v: FloatArray
    stroke: FloatArray
    pressure: FloatArray
    supply: FloatArray
    tank: FloatArray
    temperature: FloatArray


def guesses_of(machine: Machine, truth: ValvePlantTruth, rng: np.random.Generator) -> list[Guess]:
    """Guess each axis as a person would: speed and delay to 15 %, dead band to 2 % of full."""
    guesses = []
    for joint in machine.joints:
        assert joint.cylinder is not None
        x = joint.cylinder.linkage.piston_position(np.linspace(*joint.limits.position, 101))
        valve = truth.valves[joint.name]
        edges = [valve.lands[name].edge for name in ("head_in", "rod_in")]
        spool = valve.spool
        guesses.append(
            Guess(
                float(x.min()),
                float(x.max()),
                float(valve.lands["head_in"].flow / joint.cylinder.head_area * rng.uniform(0.9, 1.2)),
                float(np.mean(edges) + rng.uniform(-0.02, 0.02)),
                float((spool.delay_extend + spool.damping / (np.pi * spool.frequency)) * rng.uniform(0.85, 1.15)),
            )
        )
    return guesses


def run_all(runs: Sequence[Run]) -> list[Course]:
    """Run programmes side by side, each to its end (machines of one kind and one rate only)."""
    rate = runs[0].machine.rate_hz
    per_cycle = round(1.0 / rate / STEP)
    plant = ValvePlant(
        [(run.machine, run.truth) for run in runs],
        STEP,
        [run.power_on for run in runs],
        [np.random.default_rng(run.noise) for run in runs],
    )
    count = plant.shape[0]
    low = np.array([[guess.low for guess in run.guesses] for run in runs]).T
    high = np.array([[guess.high for guess in run.guesses] for run in runs]).T
    start = np.array([run.start or (0.5,) * count for run in runs]).T
    plant.place(low + start * (high - low))
    operators = [Operator(run.phases, run.guesses, 1.0 / rate) for run in runs]
    rows: list[list[FloatArray]] = []
    lengths = [0] * len(runs)
    commands = np.zeros(plant.shape)
    while True:
        state = plant.state
        for p, operator in enumerate(operators):
            if not operator.done:
                commands[:, p] = operator(state.x[:, p])
                lengths[p] += not operator.done
        if all(operator.done for operator in operators):
            break
        commands = np.round(np.clip(commands, -1.0, 1.0) * COMMAND_STEPS) / COMMAND_STEPS
        rows.append([commands, state.q, state.x, state.v, state.stroke, state.pressure, state.supply,
                     state.tank, state.temperature])  # fmt: skip
        for _ in range(per_cycle):
            plant.step(commands)
        commands = commands.copy()
    columns = [np.stack(column) for column in zip(*rows, strict=True)]
    return [
        Course(np.arange(length) / rate, *(np.ascontiguousarray(column[:length, ..., p]) for column in columns))
        for p, length in enumerate(lengths)
    ]


def recorded(
    machine: Machine, course: Course, quality: SensorQuality, rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Measure a run, by channel in SI (commands as they are sent), and ``time``."""
    names = [joint.name for joint in machine.joints]
    ideal = np.empty((len(course.time), len(machine.channels)))
    for k, channel in enumerate(machine.channels):
        j = -1 if channel.joint is None else names.index(channel.joint)
        ideal[:, k] = channel_values(machine, course, channel.quantity, j)
    measured = SensorChain(machine, quality, rng)(ideal)
    return {"time": course.time} | {c.name: measured[:, k] for k, c in enumerate(machine.channels)}


def channel_values(machine: Machine, course: Course, quantity: str, j: int) -> FloatArray:
    """Compute an ideal transducer's values of joint ``j`` (of the machine: any), (N,) in SI; commands as sent."""
    if quantity == "command":
        cylinder = machine.joints[j].cylinder
        assert cylinder is not None and cylinder.valve is not None
        valve = cylinder.valve
        return np.asarray(valve.neutral + valve.extends * valve.full * course.command[:, j])
    chambers = {"head_pressure": 0, "rod_pressure": 1}
    if quantity in chambers:
        return course.pressure[:, chambers[quantity], j]
    if quantity in ("joint_position", "piston_position"):
        return (course.q if quantity == "joint_position" else course.x)[:, j]
    return {
        "supply_pressure": course.supply,
        "tank_pressure": course.tank,
        "oil_temperature": course.temperature,
    }[quantity]


@dataclass(frozen=True)
class ValveCase:
    """Recordings of one machine by file stem (role before the hyphen), and what is true.

    Attributes
    ----------
    machine, truth : as declared and as it really is, undeclared effects included
    healthy : the truth before them
    effects : what was put in
    courses : what really happened
    tables : what was recorded, SI by channel
    """

    machine: Machine
    truth: ValvePlantTruth
    healthy: ValvePlantTruth
    effects: tuple[ValveEffectSpec, ...]
    courses: Mapping[str, Course]
    tables: Mapping[str, Mapping[str, FloatArray]]


def simulate_valve_case(
    machine: Machine,
    healthy: ValvePlantTruth,
    programmes: Mapping[str, Sequence[Phase]],
    guesses: Sequence[Guess],
    *,
    effects: Sequence[ValveEffectSpec] = (),
    quality: SensorQuality | None = None,
    seed: int = 0,
) -> ValveCase:
    """Record every programme (by file stem) on one machine that has undeclared effects.

    Recordings follow each other by two and a half minutes, so the oil gets warmer from one to the next. Noise and
    restlessness depend on ``seed`` and the stem's place alone.
    """
    return simulate_valve_cases([(machine, healthy, programmes, guesses, effects, quality, seed)])[0]


Order = tuple[
    Machine, ValvePlantTruth, Mapping[str, Sequence[Phase]], Sequence[Guess], Sequence[ValveEffectSpec],
    SensorQuality | None, int,
]  # fmt: skip


def simulate_valve_cases(orders: Sequence[Order]) -> list[ValveCase]:
    """Simulate several cases of one kind side by side, arguments as of :func:`simulate_valve_case`."""
    runs, truths = [], []
    for machine, healthy, programmes, guesses, effects, _, seed in orders:
        truth = healthy
        for spec in effects:
            truth = with_effect(machine, truth, spec)
        truths.append(truth)
        runs += [
            Run(machine, truth, phases, guesses, power_on=150.0 * number, noise=(seed, 52, number))
            for number, phases in enumerate(programmes.values())
        ]
    courses = iter(run_all(runs))
    cases = []
    for (machine, healthy, programmes, _, effects, quality, seed), truth in zip(orders, truths, strict=True):
        own = {stem: next(courses) for stem in programmes}
        tables = {
            stem: recorded(machine, course, quality or SensorQuality(), np.random.default_rng([seed, 51, number]))
            for number, (stem, course) in enumerate(own.items())
        }
        cases.append(ValveCase(machine, truth, healthy, tuple(effects), own, tables))
    return cases


def write_valve_case(folder: str | Path, case: ValveCase, **more: Any) -> None:
    """Write ``machine.yaml``, a Parquet file per recording, ``truth.yaml`` with effects and ``more``."""
    folder = Path(folder)
    write_tables(folder, case.machine, case.tables)
    content = {"machine": case.machine.name, "effects": [asdict(e) for e in case.effects], **more}
    content |= case.truth.to_dict()
    (folder / "truth.yaml").write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
