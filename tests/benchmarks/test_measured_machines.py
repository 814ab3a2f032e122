"""Measured machines: published base models, and what the loop finds with no help. Skipped where the data is absent.

The loop is tried on machines of one joint; on the six of the TX40, which it takes 20 s, by ``hilfit bench measured``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks import pages
from benchmarks.measured import DATA, MACHINES, emps, run, seals, staubli
from benchmarks.measured.seals import Pressure
from benchmarks.measured.stacks import refitted, relative
from benchmarks.targets import silent
from daq.machine.machine_file import load_machine, parse_machine
from fitting.effects import line_effect


def data(name: str) -> Path:
    """The folder of one machine's data; skips where it is not beside the repository."""
    path = DATA / name
    if not path.is_dir():
        pytest.skip(f"measured data '{name}' is not beside the repository (../shared/data)")
    return path


def test_emps_base_model_is_the_published_one(tmp_path: Path) -> None:
    base, decimated, raw = emps.base_model(data("emps"), tmp_path)
    for name in ("M", "Fv", "Fc"):
        assert base[name] == pytest.approx(emps.PUBLISHED[name], rel=0.003), name
    assert base["offset"] == pytest.approx(emps.PUBLISHED["offset"], rel=0.02)
    # Another zero-phase filter than the publication's: the errors agree to two per cent of themselves.
    assert decimated == pytest.approx(emps.PUBLISHED_ERRORS, rel=0.02)
    assert raw[0] > decimated[0] and raw[1] > decimated[1]


@pytest.mark.slow
def test_the_loop_finds_asymmetric_friction_on_emps(tmp_path: Path) -> None:
    result = emps.evaluate(data("emps"), tmp_path)
    assert "asymmetric_friction" in result.found.names
    machine, lines = load_machine(emps.MACHINE), result.found.results["attribution"]["lines"]
    assert not any(line_effect().applies(machine, line["joint"]) for line in lines)  # electric: no oil, no pump
    assert result.found.results["residual"]["measured"]  # the noise floor is that of the repeated reference
    assert result.asymmetric[0] == pytest.approx(emps.PUBLISHED_ASYMMETRIC_ERROR, rel=0.03)
    own, cross = result.after
    assert own <= 3.2
    assert cross <= 5.4


@pytest.mark.slow
def test_tx40_tells_61_parameters(tmp_path: Path) -> None:
    folder = data("staubli_tx40")
    session = staubli.session_of(staubli.recording(folder, tmp_path))
    base = refitted(session, ())
    told, errors = staubli.base_errors(base)
    assert told == 61
    assert errors.every_row <= 8.4
    assert errors.moving < errors.every_row  # standstill and reversals are what the base model cannot do
    assert errors.every_row < errors.every_row_blocks < 10.0
    for name, with_it in staubli.trials(session).items():  # what the loop refuses here would not help
        assert with_it.every_row_blocks >= errors.every_row_blocks - 0.05, name
    friction = {name: (published, here) for name, published, here in staubli.friction(folder, base)}
    for name in ("fv1", "fv2", "fv3", "fv4", "fv5", "fv6", "fvm6"):
        published, here = friction[name]
        assert here == pytest.approx(published, rel=0.06), name


def test_seal_friction_grows_with_pressure() -> None:
    folder = data("pneumatic_cylinder")
    for seal, pressures in seals.SEALS.items():
        area, read = seals.readings([seals.read_run(folder / f"{seal}_{bar}bar.csv") for bar in pressures])
        assert 0.0245 < 2 * np.sqrt(area / np.pi) < 0.0262, seal
        assert [r.bar for r in read] == pytest.approx(pressures, abs=0.15)
        friction = [r.friction for r in read]
        assert friction == sorted(friction), seal
        assert all(r.friction < r.width for r in read), seal  # the regulator's hysteresis is part of the loop
        _, slope, std = seals.line(read)
        assert 0.4 < slope < 1.5 and slope > 3 * std, seal


@pytest.mark.slow
@pytest.mark.parametrize("seal", ["Circle", "NAP310"])
def test_the_loop_names_pressure_dependent_friction(seal: str, tmp_path: Path) -> None:
    result = seals.evaluate(data("pneumatic_cylinder"), tmp_path, seal, kept=(5,))
    (trial,) = result.trials
    assert trial.named
    # Two readings of one slope; they share the data but neither speed nor reversals.
    assert trial.fitted == pytest.approx(result.slope, rel=0.25)
    assert trial.before[1] is not None and trial.after[1] is not None
    assert trial.after[1] < 0.75 * trial.before[1]


def test_what_is_absent_is_said_and_skipped(tmp_path: Path) -> None:
    written = tmp_path / "page.md"
    outcome = run(tmp_path / "nothing", written, None, silent)
    assert not outcome.checks
    assert len(outcome.notes) == len(MACHINES) and all("skipped" in note for note in outcome.notes)
    assert written.read_text(encoding="utf-8").startswith("# Measured machines")
    assert len(run(tmp_path / "nothing", None, "emps", silent).notes) == 1


@pytest.mark.parametrize("module", [emps, staubli, seals])
def test_machine_files_of_the_measured_machines_load(module: object) -> None:
    machine = load_machine(module.MACHINE)  # type: ignore[attr-defined]
    assert machine.channels


def test_a_seals_machine_has_the_bore_of_its_area() -> None:
    machine = seals.machine_of("Circle", 5e-4)
    cylinder = machine.joints[0].cylinder
    assert cylinder is not None and cylinder.head_area == pytest.approx(5e-4, rel=1e-3)
    assert machine.name == "Circle"
    assert parse_machine(seals.MACHINE.read_text(encoding="utf-8")).name == "pneumatic-cylinder"


def test_the_weighted_line_and_its_standard_deviation() -> None:
    bar = np.array([1.0, 3.0, 5.0, 7.0])
    rng = np.random.default_rng(4)
    slopes, stds = [], []
    for _ in range(400):
        friction = 2.0 + 0.8 * bar + 0.05 * rng.standard_normal(4)
        read = [Pressure(b, f, 0.05, f + 1, 0.01, 0.01, 9) for b, f in zip(bar, friction, strict=True)]
        _, slope, std = seals.line(read)
        slopes.append(slope)
        stds.append(std)
    assert np.mean(slopes) == pytest.approx(0.8, abs=0.002)
    assert np.median(stds) == pytest.approx(np.std(slopes), rel=0.2)
    bent = [Pressure(b, 2.0 + b - 0.05 * b**2, 0.05, 0.0, 0.01, 0.01, 9) for b in bar]
    assert seals.line(bent)[2] > 1.5 * np.median(stds)  # a law that is not straight says so


@pytest.mark.slow
def test_figures_do_not_depend_on_the_day() -> None:
    x = np.linspace(-1, 1, 500)
    first, second = (pages.residuals(x, np.sin(9 * x), 0.1 * x, "speed [m/s]", "N") for _ in range(2))
    assert first == second
    assert "speed [m/s]" in first and "<metadata>" not in first
    assert len(first) < 150_000


def test_relative_error_is_a_ratio_of_norms() -> None:
    assert relative([3.0, 4.0], [30.0, 40.0]) == pytest.approx(10.0)
