"""The directories of stages: one for each execution, and one that stays."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from dbos import DBOS
from service_fakes import Fakes, ran, running_service

from server.identifications.identification_results import IdentificationResults
from server.jobs.claims import Claim
from server.jobs.job_places import begin, place_name, tidy
from server.platform.files import DataDirectory


def test_an_execution_has_what_the_stage_before_left_and_shares_none_of_its_bytes(tmp_path: Path) -> None:
    first, second = place_name(Claim("job-1", "one", 1), "check"), place_name(Claim("job-1", "two", 2), "fit")
    files = DataDirectory(tmp_path / "data")
    directory = files.identifications / "one"
    assert not begin(files, directory, first, None, {}), "nothing was before it"
    (directory / first / "stages").mkdir()
    (directory / first / "stages" / "check.json").write_text("{}")
    assert begin(files, directory, second, first, {})
    with (directory / first / "stages" / "check.json").open("a") as late:
        late.write("late")
    assert (directory / second / "stages" / "check.json").read_text() == "{}"
    with pytest.raises(FileExistsError):
        begin(files, directory, second, first, {})
    assert not begin(files, directory, "3-fit", "1-lost", {})
    (directory / "note.txt").touch()
    tidy(files, directory, second, ())
    assert sorted(path.name for path in directory.iterdir()) == [second, "note.txt"]


@pytest.mark.slow
@pytest.mark.parametrize("lost", [False, True])
def test_a_job_goes_on_from_what_was_recorded_and_begins_anew_where_its_files_are_gone(
    tmp_path: Path, csv: bytes, lost: bool
) -> None:
    with running_service(tmp_path, Fakes()) as first:
        order = first.order(csv, block="cylinder_stage")
        first.follow(order.job, lambda event: event["text"] == "Half of cylinder_stage")
        directory = first.service.files.identifications / order.id
    names = [path.name for path in directory.iterdir() if path.is_dir()]
    assert "1-check" in names
    if lost:  # as in a backup that was made while the job ended
        shutil.rmtree(directory / "1-check")
    (directory / "go").touch()
    with running_service(tmp_path, Fakes()) as second:
        assert DBOS.get_result(order.job) == "done"
        (kept,) = (path for path in directory.iterdir() if path.is_dir())
        assert kept == second.service[IdentificationResults].directory(order.id)
        assert {path.name for path in kept.iterdir()} >= {"report.json", "check.log", "summary-check.json"}
        again = ["check"] if lost else []
        assert ran(second, order.id) == ["check", "cylinder_stage", *again, "cylinder_stage", "report"]
        steps = [step["function_name"] for step in DBOS.list_workflow_steps(order.job)]
        assert steps == ["check", "cylinder_stage", "report", "finish"]
