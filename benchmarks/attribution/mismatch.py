"""Position mismatches by the hundred: what bends a joint's two position sensors, on motions that are simulated once.

An arm's motion and forces are simulated once for many cases; each then gets its own transducers and its own defects
between the two sensors, at the rate of the recordings, by the plant's own code. The fit sees machine file and
recordings, and does all that it does up to the check of position sensors; efforts are not searched.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.attribution.judging import Findings, recordings_of
from benchmarks.attribution.making import TrueEffect
from benchmarks.attribution.recipe import FULL_SCALE, SIGNED, TARGETS, draw_quality
from benchmarks.attribution.sight import beyond, gap_std, zeros_of
from benchmarks.attribution.verdicts import verdict
from benchmarks.cases import Line
from benchmarks.targets import Check, rate
from daq.machine.machine_file import Machine
from fitting.arrays import FloatArray
from fitting.loop.kinematic_check import gap_posteriors
from fitting.loop.session import Options, Session
from fitting.selection.gaps import GapPosterior
from sim_backends.machines import ARMS, ArmKind
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.cases import CasePlan, plan_case
from sim_backends.plant.plant import SETTLE_TIME, Plant
from sim_backends.plant.sensors import SensorChain
from sim_backends.plant.truth import SensorQuality
from sim_backends.undeclared import (
    MISMATCH,
    OUTSIDE_MISMATCH,
    UNDECLARED,
    Block,
    EffectSpec,
    Place,
    Readings,
    UndeclaredEffect,
    obstacle,
)

Tables = dict[str, dict[str, FloatArray]]

STEMS = ("unloaded", "train-1", "train-2", "repeat")
CLASSES = ("sound", "one", "two", "outside")
GEOMETRY = ("encoder_offset", "encoder_eccentricity", "linkage_geometry")
#: Two at once: an error of geometry with something that gives way to a force.
PAIRS = (
    ("linkage_geometry", "cylinder_compliance"),
    ("linkage_geometry", "joint_compliance"),
    ("encoder_offset", "cylinder_compliance"),
    ("encoder_offset", "joint_compliance"),
    ("encoder_eccentricity", "pin_play"),
    ("encoder_eccentricity", "joint_play"),
)
#: Faults of the effort in a third of the sound cases, and their sizes over the Coulomb friction.
EFFORT_FAULTS = {"stribeck": 2.0, "position_dependent_friction": 1.5, "end_cushion": 6.0, "gas_spring": 10.0}
#: Largest displacement of a sound structure under a usual force, and largest errors of geometry, m or rad.
_LARGEST = {"encoder_offset": 0.1, "encoder_eccentricity": 0.03, "linkage_geometry": 0.01}
_MOST_MOVED = 0.005
#: Share of the time that a play spends on either side: on one side alone it is an offset, on neither a compliance.
_LEAST_CROSSED = 0.05
_DRAWS = 200
#: Cases in a row on the motions of one arm.
PER_ARM = 6


@dataclass(frozen=True)
class _GapCase:
    """A case: what the fit may see, and what it may not."""

    machine: Machine
    tables: Tables
    effects: tuple[TrueEffect, ...]
    note: str


@lru_cache(maxsize=3)
def _motion_blocks(arm: ArmKind, seed: int, fault: str | None) -> tuple[CasePlan, Plant, dict[str, Block]]:
    """Compute an arm's motions and forces at its recordings' rate; ``fault``: of the effort on the second joint."""
    plan = plan_case(arm, seed)
    quality = draw_quality(np.random.default_rng([seed, 20]), FULL_SCALE[arm])
    specs = []
    if fault is not None:
        joint = plan.machine.joints[1].name
        specs = [EffectSpec(fault, joint, EFFORT_FAULTS[fault] * plan.truth.cylinders[joint].f_c)]
    blocks = {}
    for stem in STEMS:
        plant = Plant(
            plan.machine, plan.truth, undeclared=specs, quality=quality,
            rng=np.random.default_rng([seed, 12, STEMS.index(stem)]), shapes=np.random.default_rng([seed, 13]),
        )  # fmt: skip
        blocks[stem] = _recorded(plant, plan, stem)
    return plan, plant, blocks


def _recorded(plant: Plant, plan: CasePlan, stem: str) -> Block:
    """Record one motion as a block with a row for every row of its recording."""
    motion, steps = plan.motions[stem], plant.steps.per_period
    settling = round(SETTLE_TIME * plan.machine.rate_hz)
    plant.controller.place(motion)
    plant.set_clock(-settling)
    plant.sample(settling)
    plant.controller.follow(motion, at_once=True)
    left, parts = round(motion.duration * plan.machine.rate_hz) * steps, list[Block]()
    while left > 0:
        n = min(left, plant.controller.remaining or left)
        parts.append(plant.step(n)[0])
        left -= n
    rows = {
        name: np.concatenate([getattr(part, name)[steps - 1 :: steps] for part in parts])
        for name in Block.__dataclass_fields__
        if name not in ("dt", "pinned")
    }
    return Block(dt=1.0 / plan.machine.rate_hz, pinned=parts[0].pinned, **rows)


def _make_case(kind: str, number: int, seed: int) -> _GapCase:
    """Make a case of a class; :data:`PER_ARM` of them in a row share the motions of one arm."""
    rng = np.random.default_rng([78, seed, CLASSES.index(kind), number])
    group = number // PER_ARM
    arm, arm_seed = tuple(ARMS)[group % len(ARMS)], 100_000 * (seed % 10_000) + 97 * group + CLASSES.index(kind)
    fault = None
    if kind == "sound" and number % 3 == 2:  # one fault an arm: motions are simulated once for each
        rng.choice(list(EFFORT_FAULTS))  # once drawn from all: cases of a seed stay the same
        fault = list(EFFORT_FAULTS)[group % len(EFFORT_FAULTS)]
    plan, plant, blocks = _motion_blocks(arm, arm_seed, fault)
    quality = draw_quality(rng, FULL_SCALE[arm])
    if kind == "sound":
        turn = 2 * float(np.pi) / 2 ** int(rng.integers(12, 21))
        step = float(rng.choice([1e-6, 5e-6, 2e-5, 5e-5, 1e-4]))
        quality = replace(quality, encoder_resolution=turn, piston_resolution=step)
    specs = _specs(kind, rng, plan, blocks, quality)
    delay = float(rng.choice([0.0, 0.0, rng.uniform(-0.01, 0.01)])) if kind == "sound" else 0.0
    tables = _tables(plan, plant, blocks, [s for s, _ in specs], quality, rng, delay)
    note = fault or ""
    if kind == "sound" and number % 10 == 4:
        tables, note = _half_parked(plan.machine, tables, rng, quality), note + " parked"
    if kind == "sound" and number % 10 == 7:
        note += " lost"
        for table in tables.values():
            lost = rng.random(len(table["time"])) < 0.02
            for name in table:
                if name != "time":
                    table[name] = np.where(lost, np.nan, table[name])
    effects = tuple(_true(plan, spec, seen, n, len(specs)) for n, (spec, seen) in enumerate(specs))
    return _GapCase(plan.machine, tables, effects, f"{arm}{note} {1e3 * delay:.1f}ms")


def _specs(
    kind: str, rng: np.random.Generator, plan: CasePlan, blocks: Mapping[str, Block], quality: SensorQuality
) -> list[tuple[EffectSpec, float]]:
    """Draw what is put between the sensors, and by how many noise widths of a sample it moves them."""
    if kind == "sound":
        return []
    for _ in range(_DRAWS):
        joint = int(rng.integers(len(plan.machine.joints)))
        if kind == "two":
            ids: tuple[str, ...] = PAIRS[int(rng.integers(len(PAIRS)))]
        elif kind == "outside":
            ids = (OUTSIDE_MISMATCH[int(rng.integers(len(OUTSIDE_MISMATCH)))],)
        else:
            pool = (*GEOMETRY, "backlash", *MISMATCH)
            ids = (pool[int(rng.integers(len(pool)))],)
        low, high = TARGETS["kinematic"]
        targets = np.exp(rng.uniform(np.log(low), np.log(high), size=len(ids)))
        rng.bit_generator.random_raw()  # once a seed of shapes: cases of a seed stay the same
        described = plan.machine.joints[joint]
        if any(obstacle(UNDECLARED[own], described) is not None for own in ids):
            continue
        specs = []
        for own, target in zip(ids, targets, strict=True):
            sign = float(rng.choice([-1.0, 1.0])) if own in SIGNED else 1.0
            found = _scaled(plan, blocks, quality, EffectSpec(own, described.name, sign), float(target))
            if found is not None:
                specs.append((found, float(target)))
        if len(specs) == len(ids):
            return specs
    raise RuntimeError("no draw can be seen")


def _scaled(
    plan: CasePlan, blocks: Mapping[str, Block], quality: SensorQuality, unit: EffectSpec, target: float
) -> EffectSpec | None:
    """Scale the effect to move the sensors by ``target`` noise widths; None where that is no such defect."""
    joint = [j.name for j in plan.machine.joints].index(str(unit.joint))
    lever = np.concatenate([blocks[stem].lever[:, joint] for stem in ("train-1", "train-2")])
    width = gap_std(quality, lever)
    size = 1e-3 if unit.id in GEOMETRY else 1.0
    for _ in range(3):
        spec = replace(unit, size=unit.size * size)
        moved = np.concatenate([_moved(plan, blocks[stem], spec, joint) for stem in ("train-1", "train-2")])
        largest = 0.0
        if unit.id not in GEOMETRY:
            largest = float(np.max(np.abs(moved)))
            # A zero of either sensor looks like this much of it: play on one side is an offset.
            zeros = zeros_of(lever)
            if unit.id in OUTSIDE_MISMATCH:  # and so much of it is one of the catalogue's
                load = np.concatenate([blocks[stem].load[:, joint] for stem in ("train-1", "train-2")])
                zeros = np.column_stack([zeros, load, load * lever**2])
            play = "backlash" in (unit.id, UNDECLARED[unit.id].called)
            if play and _crossed(moved, lever, unit.id) < _LEAST_CROSSED:
                return None
            moved = beyond(zeros, moved)
        seen = float(np.sqrt(np.mean(moved**2))) / width
        if not seen > 0:
            return None
        size *= target / seen
        largest *= target / seen
    if size > _LARGEST.get(unit.id, np.inf) or largest > _MOST_MOVED:
        return None
    return replace(unit, size=unit.size * size)


def _crossed(moved: FloatArray, lever: FloatArray, effect: str) -> float:
    """Compute the share of the rows (n,) in which a play is crossed to its rarer side."""
    side = moved / lever if effect == "joint_play" else moved
    ends = np.array([np.mean(side >= 0.99 * np.max(np.abs(side))), np.mean(side <= -0.99 * np.max(np.abs(side)))])
    return float(ends.min())


def _moved(plan: CasePlan, block: Block, spec: EffectSpec, joint: int) -> FloatArray:
    """Compute the gap's change (n,), m, by one defect, in the first shape that a generator draws."""
    readings, cylinder = _readings(plan, block, [spec]), plan.machine.joints[joint].cylinder
    assert cylinder is not None
    x = cylinder.linkage.piston_position
    piston, angle = readings.piston_position[:, joint], readings.joint_position[:, joint]
    return np.asarray(piston - block.x[:, joint] - x(angle) + x(block.q[:, joint]))


def _effects(plan: CasePlan, specs: Sequence[EffectSpec]) -> list[UndeclaredEffect]:
    rng, names = np.random.default_rng([plan.seed, 14]), [j.name for j in plan.machine.joints]
    dt = 1.0 / plan.machine.rate_hz
    return [
        UNDECLARED[s.id](Place(plan.machine, plan.truth, names.index(str(s.joint)), dt, rng.spawn(1)[0]), s.size)
        for s in specs
    ]


def _readings(plan: CasePlan, block: Block, specs: Sequence[EffectSpec]) -> Readings:
    """Apply the defects of some sensors to ideal readings."""
    effects = _effects(plan, specs)
    design = ArmDesign(plan.machine, plan.truth)
    piston = block.x.copy()
    if block.pinned:
        changed = design
        for effect in effects:
            changed = effect.redesign(changed)
        if changed is not design:
            zeros = np.zeros_like(block.q)
            piston = Arm(changed).piston(block.q, zeros, zeros)[0]
    readings = Readings(
        joint_position=block.q.copy(),
        piston_position=piston,
        head_pressure=block.p1.copy(),
        rod_pressure=block.p2.copy(),
        cylinder_force=block.load.copy(),
        joint_effort=block.load.copy(),
        supply_pressure=np.full(len(block.time), plan.truth.hydraulics.supply),
    )
    for effect in effects:
        effect.sense(block, readings)
    return readings


def _tables(
    plan: CasePlan, plant: Plant, blocks: Mapping[str, Block], specs: Sequence[EffectSpec], quality: SensorQuality,
    rng: np.random.Generator, delay: float,
) -> Tables:  # fmt: skip
    chain = SensorChain(plan.machine, quality, rng.spawn(1)[0])
    tables = {}
    for stem, block in blocks.items():
        readings = _readings(plan, block, specs)
        if delay:
            late = np.clip(block.time - delay, block.time[0], block.time[-1])
            readings.joint_position = np.asarray(CubicSpline(block.time, readings.joint_position)(late))
        values = chain(plant.channels(block, readings))
        rows = np.arange(len(values)) / plan.machine.rate_hz
        tables[stem] = {"time": rows} | {c.name: values[:, k] for k, c in enumerate(plan.machine.channels)}
    return tables


def _half_parked(machine: Machine, tables: Tables, rng: np.random.Generator, quality: SensorQuality) -> Tables:
    """Hold the machine where it stopped, for as long as it moved."""
    result = {}
    for stem, table in tables.items():
        n = len(table["time"])
        if stem == "unloaded":
            result[stem] = table
            continue
        held: dict[str, FloatArray] = {"time": np.arange(2 * n) / machine.rate_hz}
        for channel in machine.channels:
            own = table[channel.name]
            noise = np.std(np.diff(own, 4)) / np.sqrt(70) * rng.standard_normal(n)
            position = channel.quantity in ("joint_position", "piston_position")
            held[channel.name] = np.concatenate([own, np.full(n, own[-1]) + (0.0 if position else noise)])
        result[stem] = held
    return result


def _true(plan: CasePlan, spec: EffectSpec, seen: float, number: int, count: int) -> TrueEffect:
    kind = UNDECLARED[spec.id]
    own = _effects(plan, [spec] if count == 1 else [spec] * (number + 1))[-1]
    return TrueEffect(kind.called or spec.id, spec.joint, spec.size, seen, spec.joint, own.variables())


def _check_gaps(case: _GapCase) -> tuple[dict[str, GapPosterior], float]:
    """Check every joint's gap by the fit; measure its processor time after the base model's fit, s."""
    session = Session(case.machine, recordings_of(case.machine, case.tables), Options(bootstrap=0))
    assert session.base_model  # fitted before the time runs
    started = time.process_time()
    found = {session.machine.joints[joint].name: own for joint, own in gap_posteriors(session).items()}
    return found, time.process_time() - started


def _findings_of(found: Mapping[str, GapPosterior]) -> Findings:
    """Return the findings in plain names."""
    sets, laws, stated = [], [], []
    joints = list(found)
    for joint, posterior in found.items():
        for one in posterior.conclusions():
            names = [one.name, *(name for name, _ in one.rivals)]
            shares = [one.probability, *(p for _, p in one.rivals)]
            stated.append(tuple((_variable(n, joints), joint, p) for n, p in zip(names, shares, strict=True)))
            if "/" in one.name:
                laws.append((_variable(one.name, joints), joint))
            else:
                sets.append(tuple((_variable(name, joints), joint) for name in names))
    nothing = float(np.prod([next((p for s, p in own.sets if not s.names), 0.0) for own in found.values()]))
    return Findings(tuple(sets), tuple(laws), {}, tuple(stated), {}, None if sets or laws else nothing)


def _variable(name: str, joints: Sequence[str]) -> str:
    if "/" not in name:
        return name
    signal, other = name.split("/")
    return signal if other == "None" else f"{joints[int(other)]}.{signal}"


def run(counts: Mapping[str, int], seed: int) -> Iterator[Line]:
    """Run cases one after another, as lines of results; classes take turns, an arm's worth of each."""
    for group in range(max(-(-count // PER_ARM) for count in counts.values())):
        for kind, count in counts.items():
            for number in range(group * PER_ARM, min((group + 1) * PER_ARM, count)):
                yield _run_case(kind, number, seed)


def _run_case(kind: str, number: int, seed: int) -> Line:
    """Run one case: made, checked, compared."""
    started = time.process_time()
    case = _make_case(kind, number, seed)
    made = time.process_time()
    found, seconds = _check_gaps(case)
    findings = _findings_of(found)
    outcome = verdict({"sound": "null", "outside": "outside"}.get(kind, "pairs"), case.effects, findings)
    return {
        "kind": kind,
        "number": number,
        "seed": seed,
        "note": case.note,
        "effects": [[e.id, e.joint, e.size, e.seen, e.variables] for e in case.effects],
        "result": outcome.result,
        "surplus": outcome.surplus,
        "wrong_alone": outcome.wrong_alone,
        "said": [list(own) for own in findings.stated],
        "nothing": findings.nothing,
        "joints": len(found),
        "make_s": made - started,
        "session_s": time.process_time() - made - seconds,
        "check_s": seconds,
    }


def case_text(line: Line) -> str:
    """Describe a case in a line: what is there, what is found, and how that came out."""
    there = ", ".join(f"{name}@{joint} ({seen:.0f} widths)" for name, joint, _, seen, _ in line["effects"])
    found = "; ".join(" or ".join(f"{n}@{j} {p:.2f}" for n, j, p in own) for own in line["said"])
    surplus = f" +{line['surplus']}" if line["surplus"] else ""
    head = f"{line['kind']}:{line['number']} {there or 'sound'} [{line['note']}]"
    return f"{head}: {line['result']}{surplus}: {found or '-'}"


def checks(lines: Sequence[Line]) -> list[Check]:
    """Compare every rate with its target."""

    def of(*kinds: str) -> list[Line]:
        return [line for line in lines if line["kind"] in kinds]

    shown, outside, sound = of("one", "two"), of("outside"), of("sound")
    clean = sum(line["result"] == "right" and not line["surplus"] for line in shown)
    right, named = (sum(line["result"] == result for line in outside) for result in ("right", "wrong"))
    alone = sum(bool(line["wrong_alone"]) for line in shown)
    accused = sum(len({own[0][1] for own in line["said"]}) for line in sound)
    return [
        rate("visible: right without surplus", clean, len(shown), "at least", 0.95),
        rate("visible: a wrong name alone", alone, len(shown), "at most", 0.01),
        rate("outside: joint and variable", right, len(outside), "at least", 0.90),
        rate("outside: a name", named, len(outside), "at most", 0.02),
        rate("sound joints accused", accused, sum(line["joints"] for line in sound), "at most", 0.005),
    ]
