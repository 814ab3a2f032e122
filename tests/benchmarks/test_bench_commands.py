"""``hilfit bench``: the list, wrong usage, targets that are missed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from benchmarks.attribution import runs
from benchmarks.cli import BENCHMARKS
from benchmarks.demonstration import SMALL, beside_readme, numbers, printed_result
from server.commands import command_line as cli

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            cli.main(["bench", *arguments])
        output = capsys.readouterr()
        code = ended.value.code
        return (code if isinstance(code, int) else 0), output.out, output.err

    return call


def test_without_a_name_they_are_listed(run: Run) -> None:
    code, out, _ = run()
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == list(BENCHMARKS)
    code, out, _ = run("--json")
    assert code == 0
    assert [entry["name"] for entry in json.loads(out)] == list(BENCHMARKS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("attribution", "--cases", "huge=3"), "--cases huge=3: write CLASS=COUNT"),
        (("attribution", "--case", "large"), "--case large: write CLASS:NUMBER"),
        (("attribution", "--only", "stribek"), "--only stribek: is no effect of the plant"),
        (("attribution", "--arms", "folding,left"), "--arms left"),
        (("attribution", "--recipe", "2"), "--recipe 2"),
        (("attribution", "--only-make"), "name it with --cache"),
        (("attribution", "--compare", "no-such.jsonl"), "no-such.jsonl: no such file"),
        (("valve", "--only-make"), "name it with --cache"),
        (("samples", "--only", "rust"), "--only rust: is no sample"),
        (("samples", "no-such-directory"), "no-such-directory: no such directory"),
        (("speed", "--minutes", "60,10"), "--minutes 60,10: write rising numbers"),
        (("long", "--minutes", "60,10"), "--minutes 60,10: write rising numbers"),
        (("excitation", "--arm", "left"), "--arm left"),
        (("dance",), "No such command 'dance'"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_2(run: Run, arguments: tuple[str, ...], words: str) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert words in err and err.count("\n") == 1


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every case comes out right, except that every null is accused."""

    def fake(order: runs.Order) -> dict[str, Any]:
        key = order.key
        selection = order.selection.as_json()
        effects = [{"id": "stribeck", "joint": "joint1", "reported": "joint1", "seen": 20.0}]
        return {
            "kind": key.kind, "number": key.number, "seed": key.seed, "selection": selection, "arm": "folding-arm",
            "result": "accused" if key.kind == "null" else "right", "effects": [] if key.kind == "null" else effects,
            "said": {"sets": [[["stribeck", "joint1"]]], "laws": []}, "redrawn": [], "surplus": 0, "widest": 1,
            "wrong_alone": [["stribeck", "joint1"]] if key.kind == "null" else [], "located": True, "seconds": 1.0,
        }  # fmt: skip

    monkeypatch.setattr(runs, "run_case", fake)


@pytest.mark.usefixtures("results")
def test_a_missed_target_is_exit_code_1(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("attribution", "--cases", "null=2,large=1", "-o", str(tmp_path / "r.jsonl"))
    assert code == 1
    assert "MISSED no effect: accused" in out and "ok     large: right or in the set" in out
    assert "stribeck@joint1 (20.0)  ->  stribeck@joint1" in out


@pytest.mark.usefixtures("results")
def test_met_targets_are_exit_code_0_and_runs_can_be_compared(run: Run, tmp_path: Path) -> None:
    first = tmp_path / "r.jsonl"
    assert run("attribution", "--cases", "large=2", "-o", str(first))[0] == 0
    code, out, _ = run("attribution", "--cases", "large=3", "--compare", str(first))
    assert code == 0
    assert "compared on 2 cases; 0 say something else than before" in out


@pytest.mark.usefixtures("results")
def test_json_is_one_document(run: Run) -> None:
    code, out, _ = run("attribution", "--case", "large:4", "--json")
    content = json.loads(out)
    assert code == 0
    assert [case["number"] for case in content["cases"]] == [4]
    assert all(check["met"] is not False for check in content["checks"])


def test_samples_that_are_not_there_are_skipped(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("samples", str(tmp_path))
    assert code == 0
    assert out.count("skipped, it is not in") == 6


def test_the_regressor_is_timed(run: Run) -> None:
    _, out, _ = run("regressor", "--samples", "50", "--repeats", "1", "--json")
    content = json.loads(out)
    assert content["benchmark"] == "regressor"
    assert [check["measured"] is not None for check in content["checks"]][::2] == [True, True]


def test_errors_are_laid_beside_those_that_the_readme_prints() -> None:
    floor, before, after = (numbers(printed_result())[place::3] for place in range(3))
    errors = {
        f"joint{place}": {"noise_floor": row[0], "before": {"validate": row[1]}, "after": {"validate": row[2]}}
        for place, row in enumerate(zip(floor, before, after, strict=True))
    }
    assert len(errors) == 6 and beside_readme({"errors": errors}) == 0.0
    errors["joint1"]["after"] = {"validate": 1.3 * after[1]}
    assert beside_readme({"errors": errors}) == pytest.approx(0.3)
    errors["joint1"]["after"] = {"validate": after[1]}
    errors["joint5"]["noise_floor"] = floor[5] + 0.03  # less than what is printed of small ones is worth
    assert beside_readme({"errors": errors}) == pytest.approx(0.03 / SMALL)
