"""``hilfit identify --estimator``: what the report then says, and what is refused before any work."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from synthetic_arm import make_recordings, planar_machine, truth

from daq.machine.machine_file import machine_to_yaml
from daq.recordings.recording import write_recording
from fitting.arm.base_parameters import reduce_parameters
from server.commands.command_line import main

pytestmark = pytest.mark.slow

ROLES = ("unloaded", "train", "repeat", "validate")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two joints, 30 s a motion."""
    directory = tmp_path_factory.mktemp("arm")
    machine = planar_machine(2)
    (directory / "machine.yaml").write_text(machine_to_yaml(machine), encoding="utf-8")
    for recording in make_recordings(machine, truth(2), seconds=30.0):
        path = directory / f"{recording.role}.parquet"
        write_recording(path, machine, recording.role, recording.time, recording.values)
    return directory


def run(arm: Path, output: Path, *options: str, roles: tuple[str, ...] = ROLES) -> int:
    files = [part for role in roles for part in (f"--{role}", str(arm / f"{role}.parquet"))]
    with pytest.raises(SystemExit) as caught:
        main(["identify", str(arm / "machine.yaml"), *files, "-o", str(output), "--no-loop", *options])
    return int(caught.value.code or 0)


def report_of(output: Path) -> dict[str, Any]:
    return dict(json.loads((output / "report.json").read_text(encoding="utf-8")))


@pytest.fixture(scope="module")
def usual(arm: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The report without any option."""
    output = tmp_path_factory.mktemp("usual")
    assert run(arm, output) == 0
    return report_of(output)


def test_the_default_is_the_joint_refit_with_least_squares_beside_it(usual: dict[str, Any]) -> None:
    body = usual["rigid_body"]
    assert body["estimator"] == "gls" and body["stage_2"]["estimator"] == "ols"
    assert "price_percent" not in body and "joint_refit" not in body["parameters"][0]


@pytest.mark.parametrize("name", ["ols", "wls", "possible"])
def test_the_report_says_which_estimator_and_what_it_costs(
    arm: Path, usual: dict[str, Any], tmp_path: Path, name: str
) -> None:
    assert run(arm, tmp_path, "--estimator", name) == 0
    report = report_of(tmp_path)
    body = report["rigid_body"]
    assert body["estimator"] == name == body["stage_2"]["estimator"]
    assert body["covariance"] == "hac"
    for entry, before in zip(body["parameters"], usual["rigid_body"]["parameters"], strict=True):
        # The joint refit stays beside it, and differs by no more than the deviations of both allow.
        assert entry["joint_refit"]["value"] == pytest.approx(before["value"], rel=1e-9)
        assert abs(entry["value"] - before["value"]) < 5 * (entry["std"] + before["std"])
    assert set(body["errors"]) == set(report["errors"])
    # It minimises nothing that the joint refit does not: the validation error moves by a few per cent at most.
    assert abs(body["price_percent"]["validate"]) < 10
    # Hierarchical against one-shot does not depend on the option.
    assert report["one_shot"]["comparison"] == usual["one_shot"]["comparison"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"({name})" in page and "Its price" in page


def test_deviations_by_bootstrap_and_by_the_textbook(arm: Path, tmp_path: Path) -> None:
    stds = {}
    for colour in ("hac", "bootstrap", "white"):
        assert run(arm, tmp_path / colour, "--estimator", "wls", "--covariance", colour) == 0
        body = report_of(tmp_path / colour)["rigid_body"]
        assert body["covariance"] == colour
        stds[colour] = [entry["std"] for entry in body["parameters"]]
    ratios = [b / h for b, h in zip(stds["bootstrap"], stds["hac"], strict=True)]
    assert min(ratios) > 0.5 and max(ratios) < 2.0
    # Filtered rows hang together: the textbook promises more than either.
    assert sum(stds["white"]) < sum(stds["hac"])


def test_an_earlier_report_is_a_prior_that_narrows(arm: Path, tmp_path: Path) -> None:
    assert run(arm, tmp_path / "first", "--estimator", "wls") == 0
    earlier = tmp_path / "first" / "report.json"
    assert run(arm, tmp_path / "second", "--estimator", "ridge", "--prior", str(earlier)) == 0
    first, second = (report_of(tmp_path / name)["rigid_body"] for name in ("first", "second"))
    assert second["details"]["prior"] == "report.json"
    assert set(second["details"]["told_by_data"]) == {entry["name"] for entry in second["parameters"]}
    for before, after in zip(first["parameters"], second["parameters"], strict=True):
        assert after["std"] <= before["std"] * (1 + 1e-9)
    assert "recordings tell" in (tmp_path / "second" / "report.html").read_text(encoding="utf-8")


def test_the_links_of_a_possible_fit_are_in_the_report(arm: Path, tmp_path: Path) -> None:
    assert run(arm, tmp_path, "--estimator", "possible") == 0
    details = report_of(tmp_path)["rigid_body"]["details"]
    base = reduce_parameters(planar_machine(2))
    assert set(details["standard_parameters"]) == set(base.standard_names)
    assert details["smallest_eigenvalue"] > 0 and details["chi_square_price"] >= -1e-6
    assert "links that can exist" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_the_comparison_is_in_json_text_and_page(
    arm: Path, usual: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    comparison = usual["one_shot"]["comparison"]
    assert set(comparison["contenders"]) == {"hierarchical", "one_shot", "one_shot_with_unloaded", "joint_refit"}
    assert set(comparison["against"]) == {"one_shot", "one_shot_with_unloaded"}
    for way in comparison["contenders"].values():
        assert way["condition_number"] >= 1 and way["overall"] > 0 and set(way["errors"]) == set(usual["errors"])
    assert run(arm, tmp_path) == 0
    assert comparison["said"] in " ".join(capsys.readouterr().out.split())
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert comparison["said"].split(".")[0] in page and "one-shot, unloaded recordings too" in page


def test_without_an_unloaded_recording_there_is_one_contender_less(arm: Path, tmp_path: Path) -> None:
    assert run(arm, tmp_path, roles=("train", "repeat", "validate")) == 0
    comparison = report_of(tmp_path)["one_shot"]["comparison"]
    assert set(comparison["contenders"]) == {"hierarchical", "one_shot", "joint_refit"}
    assert "unloaded" not in comparison["said"]


def test_what_is_hardly_told_is_flagged_in_json_and_page(arm: Path, usual: dict[str, Any], tmp_path: Path) -> None:
    # A moving mass comes from a prior of 40 %: it has no deviation of its own, and says where it is from.
    for joint in ("joint1", "joint2"):
        mass, friction = (usual["cylinders"][joint]["parameters"][name] for name in ("m", "f_c"))
        assert mass["std"] is None and mass["told_by_data"] < 0.5
        assert friction["std"] is not None and friction["told_by_data"] > 0.9 and not friction["flagged"]
    assert {entry["name"] for entry in usual["flagged"]}.isdisjoint({"joint1.m", "joint2.m"})
    # By an estimator that knows no prior it is nothing but flagged.
    assert run(arm, tmp_path, "--estimator", "ols") == 0
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert {"joint1.m", "joint2.m"} & {entry["name"] for entry in report["flagged"]}
    assert not any("of the value" in line for line in report["warnings"])  # a mark: every report has some
    assert "⚠" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert run(arm, tmp_path / "usual") == 0
    assert "from the prior" in (tmp_path / "usual" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--estimator", "lad"), "there is no estimator 'lad'; use one of gls, ols, possible"),
        (("--estimator", "ridge"), "--prior FILE"),
        (("--covariance", "grey"), "there is no covariance 'grey'"),
        (("--estimator", "ridge", "--prior", "machine.yaml"), "machine.yaml"),
        (("--prior", "nowhere.json"), "nowhere.json"),
    ],
)
def test_a_wrong_option_is_one_line_and_exit_code_2(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], says: str
) -> None:
    options = tuple(str(arm / part) if part == "machine.yaml" else part for part in options)
    assert run(arm, tmp_path / "none", *options) == 2
    error = capsys.readouterr().err.strip()
    assert says in error and "\n" not in error
    assert not (tmp_path / "none").exists()
