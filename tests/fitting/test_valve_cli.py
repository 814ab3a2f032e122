"""``hilfit valve`` and ``hilfit.identify_valve``: what is printed and written, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from valve_bench import Bench, machine_of, written

import hilfit
from daq.machine.machine_file import machine_to_yaml
from server.commands.command_line import main


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Machine file and two recordings of 25 s."""
    folder, machine = tmp_path_factory.mktemp("bench"), machine_of()
    (folder / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for seed in (1, 2):
        written(folder, machine, Bench(), seed, 25.0)
    return folder


def run(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


@pytest.mark.slow
def test_the_report_the_tables_and_the_inverse_are_written(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(bench / "machine.yaml"), str(bench / "run-1.parquet"), "--validate", str(bench / "run-2.parquet")]
    output = tmp_path / "deep" / "out"
    assert run(["valve", *files, "-o", str(output), "--no-loop", "--to", "c", "--to", "csv"]) == 0
    printed = capsys.readouterr().out
    for word in ("boom", "extend", "static", "ARX(2,2)", "orifice", str(output / "valve.json")):
        assert word in printed, printed
    report = json.loads((output / "valve.json").read_text(encoding="utf-8"))
    assert report["schema"] == "hilfit/valve/1" and [own["role"] for own in report["data"]] == ["train", "validate"]
    names = sorted(file.name for file in (output / "inverse").iterdir())
    assert names == ["valve_boom.c", "valve_boom.csv", "valve_boom.h", "valve_boom_selftest.c"]


@pytest.mark.slow
def test_json_prints_the_report_and_nothing_else(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(bench / "machine.yaml"), str(bench / "run-1.parquet"), "-o", str(tmp_path), "--no-loop", "--json"]
    assert run(["valve", *arguments]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["axes"]["boom"]["errors"]["role"] == "train"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--to", "basic"], "--to basic: there is no such format; use one of c, csv, fmu, python, st"),
        (["--bandwidth", "40"], "and at most 10 Hz (a fifth of the rate)"),
        (["--validate", "absent.parquet"], "absent.parquet"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], said: str
) -> None:
    arguments = [str(bench / "machine.yaml"), str(bench / "run-1.parquet"), "-o", str(tmp_path / "out"), *more]
    assert run(["valve", *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("hilfit: ") and said in error and "\n" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_from_python_with_files_and_with_arrays(bench: Path) -> None:
    from matplotlib import pyplot as plt

    machine = hilfit.Machine.load(bench / "machine.yaml")
    table = Bench().run(2, 25.0)
    arrays = hilfit.Recording.from_arrays(table["time"], {own.name: table[own.name] for own in machine_of().channels})
    result = hilfit.identify_valve(machine, [bench / "run-1.parquet"], [arrays], loop=False)
    assert repr(result).startswith("ValveResult(error over the speed's RMS: boom 0.0")
    figure = result.plot()
    assert len(figure.axes) == 2 and figure.axes[0].get_ylabel() == "boom [m/s]"
    plt.close(figure)
    command = result.models["boom"].command(0.1, head=6e6, rod=1e6, supply=18e6, tank=3e5)
    opening = 0.1 / (0.30 * np.sqrt(12e6 / 1e7))  # of the bench, at 6 MPa in the head
    assert command.command == pytest.approx(0.06 + opening, abs=0.003) and command.flags == 0


def test_a_recording_is_not_fitted_and_judged_on_at_once(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = str(bench / "run-1.parquet")
    assert run(["valve", str(bench / "machine.yaml"), one, "--validate", one, "-o", str(tmp_path / "out")]) == 2
    assert "run-1.parquet: is fitted and judged on at once" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
