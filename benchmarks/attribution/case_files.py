"""Cases on disk: a folder each, with the files that ``hilfit identify`` reads, and apart from them what is true."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.attribution.apart import Apart, Rival, apart
from benchmarks.attribution.making import BenchCase, Redrawn, TrueEffect, make_case
from benchmarks.attribution.recipe import CaseKey, Selection
from daq.machine.machine_file import load_machine, machine_to_yaml
from daq.recordings.recording import write_recording
from daq.recordings.recording_files import read_table
from sim_backends.plant.cases import STEMS
from sim_backends.plant.truth import SensorQuality, load_truth, truth_to_yaml


def stored_case(folder: Path, key: CaseKey, selection: Selection | None = None) -> BenchCase:
    """Read the case from ``folder``, or make and keep it there."""
    place = _place(folder, key, selection)
    description = place / "case.json"
    if description.is_file():
        content = json.loads(description.read_text(encoding="utf-8"))
        if content["recipe"] == (selection or Selection()).recipe:
            return _read(place, key, content)
    case = make_case(key, selection)
    shutil.rmtree(place, ignore_errors=True)
    _write(place, case, (selection or Selection()).recipe)
    return case


def stored_apart(folder: Path | None, case: BenchCase, selection: Selection | None = None) -> Apart | None:
    """Read or compute a case's separability; kept beside a cached case until it is deleted there."""
    file = None if folder is None else _place(folder, case.key, selection) / "apart.json"
    if file is not None and file.is_file():
        content = json.loads(file.read_text(encoding="utf-8"))
        return None if content is None else Apart(content["seen"], tuple(Rival(**r) for r in content["rivals"]))
    found = apart(case, selection)
    if file is not None:
        file.write_text(json.dumps(None if found is None else asdict(found), indent=1), encoding="utf-8")
    return found


def _place(folder: Path, key: CaseKey, selection: Selection | None) -> Path:
    return folder / f"seed{key.seed}-{key.kind}-{key.number:04d}{(selection or Selection()).text}"


def _write(place: Path, case: BenchCase, recipe: int) -> None:
    place.mkdir(parents=True)
    (place / "machine.yaml").write_text(machine_to_yaml(case.machine), encoding="utf-8")
    for stem, table in case.recordings.items():
        values = {name: column for name, column in table.items() if name != "time"}
        write_recording(place / f"{stem}.parquet", case.machine, stem.partition("-")[0], table["time"], values)
    (place / "truth.yaml").write_text(truth_to_yaml(case.truth), encoding="utf-8")
    content = {
        "recipe": recipe,
        "quality": asdict(case.quality),
        "effects": [asdict(e) for e in case.effects],
        "redrawn": [asdict(r) for r in case.redrawn],
    }
    # Written last and in one step: a folder with it is complete.
    part = place / "case.json.part"
    part.write_text(json.dumps(content, indent=1), encoding="utf-8")
    part.replace(place / "case.json")


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
