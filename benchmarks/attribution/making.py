"""Recordings of a case, with the effect's size scaled to the lambda that was drawn; cases on disk.

A case on disk is a folder with the files that ``hilfit identify`` reads, and apart from them what is true.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.attribution.recipe import KINEMATIC, RECIPES, CaseKey, Selection, draw_effect, largest, opened
from benchmarks.attribution.sight import FITTED, Sight, delayed
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording_files import read_table
from daq.whole_files import write_whole
from fitting.arrays import FloatArray
from sim_backends.plant.cases import STEMS, CasePlan, write_tables
from sim_backends.plant.plant import Plant
from sim_backends.plant.truth import SensorQuality, Truth, load_truth, truth_to_yaml
from sim_backends.undeclared import MISMATCH, UNDECLARED, EffectSpec, obstacle

Tables = Mapping[str, Mapping[str, FloatArray]]

_DRAWS = 60
_SCALINGS = 5
_FIRST = 0.1  # of the largest size
_CLOSE = 0.12  # relative, to the lambda that was drawn
#: These also delay or scale the disturbance, which nobody can see: their waveform is taken from an undisturbed run.
DELAY = "sensor_latency"
OF_THE_SIGNAL = (DELAY, "pressure_gain")


@dataclass(frozen=True)
class TrueEffect:
    """An effect of the plant.

    Attributes
    ----------
    id, joint, size : as the plant has it
    seen : lambda (mismatch for what bends an encoder)
    reported : joint that a report gives it: None for one of the whole machine
    variables : signals whose law shows it, where it is in no catalogue
    """

    id: str
    joint: str | None
    size: float
    seen: float
    reported: str | None
    variables: tuple[str, ...] = ()


@dataclass(frozen=True)
class Redrawn:
    """A draw that was given up: the effect cannot be seen as large as was drawn on this joint of this arm."""

    id: str
    joint: str | None
    why: str


@dataclass(frozen=True)
class BenchCase:
    """A case: what the fit may see (``machine``, ``recordings``), and what it may not."""

    key: CaseKey
    machine: Machine
    recordings: Tables
    truth: Truth
    quality: SensorQuality
    effects: tuple[TrueEffect, ...]
    redrawn: tuple[Redrawn, ...]


def undisturbed(quality: SensorQuality) -> SensorQuality:
    """Return the same measurement chain on a machine that nothing shakes."""
    return replace(quality, disturbance=0.0, knock_rate=0.0)


def make_case(key: CaseKey, selection: Selection) -> BenchCase:
    """Simulate a case; the same key and selection give the same numbers.

    Raises
    ------
    RuntimeError
        If no draw reaches its size (a selection may ask for what this arm cannot show).
    """
    rng, plan, quality = opened(key, selection)
    stems = STEMS if key.kind == "null" else FITTED
    bare = {stem: plan.record(stem, (), quality) for stem in stems}
    if key.kind == "null":
        measured = {stem: bare[stem][0] for stem in STEMS}
        return BenchCase(key, plan.machine, measured, plan.truth, quality, (), ())
    recipe = RECIPES[selection.recipe]
    sight = Sight(plan.machine, plan.truth, quality, {s: t[1] for s, t in bare.items()}, recipe.positions, recipe.lines)
    bench = _Workbench(plan, quality, sight, recipe.zeros)
    redrawn: list[Redrawn] = []
    specs: list[EffectSpec] = []
    seen: list[float] = []
    tables: Tables = {}
    for _ in range(2 if key.kind == "pairs" else 1):
        found = None
        for _ in range(_DRAWS):
            unit, target = draw_effect(rng, key.kind, plan, selection)
            if any((unit.id, unit.joint) == (s.id, s.joint) for s in specs):
                continue
            unfit = None if unit.joint is None else obstacle(UNDECLARED[unit.id], plan.machine.joint(unit.joint))
            if unfit is not None:
                redrawn.append(Redrawn(unit.id, unit.joint, unfit))
                continue
            found = bench.scaled([replace(s, size=0.0) for s in specs], unit, target)
            if not isinstance(found, str):
                break
            redrawn.append(Redrawn(unit.id, unit.joint, found))
        if found is None or isinstance(found, str):
            raise RuntimeError(f"{key.text}: none of {_DRAWS} draws can be seen as large as was drawn")
        spec, size_seen, tables = found
        specs.append(spec)
        seen.append(size_seen)
    if len(specs) > 1:
        tables = {stem: plan.record(stem, specs, quality)[0] for stem in STEMS}
    else:
        tables = {**tables, "validate": plan.record("validate", specs, quality)[0]}
    plant = Plant(
        plan.machine, plan.truth, undeclared=specs, quality=quality,
        rng=np.random.default_rng([plan.seed, 12, 0]), shapes=np.random.default_rng([plan.seed, 13]),
    )  # fmt: skip
    effects = tuple(
        TrueEffect(
            e.called or s.id, s.joint, s.size, lam, None if UNDECLARED[s.id].base_wide else s.joint, e.variables()
        )
        for s, lam, e in zip(specs, seen, plant.effects, strict=True)
    )
    ordered = {stem: tables[stem] for stem in STEMS}
    return BenchCase(key, plan.machine, ordered, plan.truth, quality, effects, tuple(redrawn))


@dataclass(frozen=True)
class _Workbench:
    plan: CasePlan
    quality: SensorQuality
    sight: Sight
    zeros: int

    @cached_property
    def _undisturbed(self) -> tuple[SensorQuality, Tables]:
        quality = undisturbed(self.quality)
        return quality, {stem: self.plan.record(stem, (), quality)[1] for stem in FITTED}

    def scaled(
        self, before: Sequence[EffectSpec], unit: EffectSpec, target: float
    ) -> tuple[EffectSpec, float, Tables] | str:
        """Scale the effect to be visible by ``target``; return it, how visible it is, measured tables; or why not.

        ``before`` are effects of size 0 that precede it, so that its hidden shape is that of the whole case.
        """
        most = largest(unit.id, self.plan, unit.joint)
        quality, bare = self._undisturbed if unit.id in OF_THE_SIGNAL else (self.quality, None)
        size = _FIRST * most
        for _ in range(_SCALINGS):
            spec = replace(unit, size=unit.size * size)
            if unit.id == DELAY and bare is not None and unit.joint is not None:
                both, ideal = {}, delayed(self.plan.machine, bare, unit.joint, spec.size)
            else:
                both = {stem: self.plan.record(stem, [*before, spec], quality) for stem in FITTED}
                ideal = {stem: pair[1] for stem, pair in both.items()}
            seen = self._seen(unit.id, ideal, bare)
            if abs(seen / target - 1.0) < _CLOSE:
                if bare is not None:
                    both = {stem: self.plan.record(stem, [*before, spec], self.quality) for stem in FITTED}
                return spec, seen, {stem: pair[0] for stem, pair in both.items()}
            if seen < 1e-3 * target:
                return "invisible"
            size *= target / seen
            if size > most:
                return f"would have to be {size / most:.1f} times the largest plausible size"
        return "its size does not converge"

    def _seen(self, effect: str, ideal: Tables, bare: Tables | None) -> float:
        if effect in (*KINEMATIC, *MISMATCH):
            return self.sight.mismatch(ideal, zeros=self.zeros if effect in ("backlash", *MISMATCH) else 0)
        return self.sight.broadband(ideal) if effect == "supply_ripple" else self.sight.force(ideal, bare)


def stored_case(folder: Path, key: CaseKey, selection: Selection) -> BenchCase:
    """Read the case from ``folder``, or make and keep it there."""
    place = place_of(folder, key, selection)
    description = place / "case.json"
    if description.is_file():
        content = json.loads(description.read_text(encoding="utf-8"))
        if content["recipe"] == selection.recipe:
            return _read(place, key, content)
    case = make_case(key, selection)
    shutil.rmtree(place, ignore_errors=True)
    _write(place, case, selection.recipe)
    return case


def place_of(folder: Path, key: CaseKey, selection: Selection) -> Path:
    """Return the folder of a case."""
    return folder / f"seed{key.seed}-{key.kind}-{key.number:04d}{selection.text}"


def _write(place: Path, case: BenchCase, recipe: int) -> None:
    write_tables(place, case.machine, case.recordings)
    (place / "truth.yaml").write_text(truth_to_yaml(case.truth), encoding="utf-8")
    content = {
        "recipe": recipe,
        "quality": asdict(case.quality),
        "effects": [asdict(e) for e in case.effects],
        "redrawn": [asdict(r) for r in case.redrawn],
    }
    # Written last and in one step: a folder with it is complete.
    write_whole(place / "case.json", json.dumps(content, indent=1).encode())


def _read(place: Path, key: CaseKey, content: dict[str, object]) -> BenchCase:
    machine = load_machine(place / "machine.yaml")
    recordings = {}
    for stem in STEMS:
        # Without the checks of a recording: they would refuse a few cases (coarse pressure transducers on a flat
        # pressure pass for saturated), and a case has to be the same from a cache as without one.
        table = read_table(place / f"{stem}.parquet")
        recordings[stem] = {name: np.asarray(values, dtype=np.float64) for name, values in table.columns.items()}
    effects, redrawn, quality = content["effects"], content["redrawn"], content["quality"]
    assert isinstance(effects, list) and isinstance(redrawn, list) and isinstance(quality, dict)
    return BenchCase(
        key=key,
        machine=machine,
        recordings=recordings,
        truth=load_truth(place / "truth.yaml"),
        quality=SensorQuality(**quality),
        effects=tuple(TrueEffect(**{**e, "variables": tuple(e["variables"])}) for e in effects),
        redrawn=tuple(Redrawn(**r) for r in redrawn),
    )
