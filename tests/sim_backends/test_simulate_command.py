"""``hilfit simulate``: bad usage in one line, and a run that ends on a signal."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import sim_backends.machines
from daq.machine.machine_file import load_machine
from sim_backends import default_machine, random_motion, write_motion
from sim_backends.cli import register
from sim_backends.plant.truth import load_truth, truth_to_yaml

FILE = str(Path(sim_backends.machines.__file__).with_name("folding_arm.yaml"))
APP = typer.Typer()
register(APP)
APP.command("other")(lambda: None)  # with one command only, typer takes no command name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["missing.yaml"], "missing.yaml: no such file"),
        ([FILE, "--undeclared", "bent_gide:joint1:3"], "did you mean 'bent_guide'"),
        ([FILE, "--undeclared", "bent_guide:joint9:3"], "there is no joint 'joint9'"),
        ([FILE, "--undeclared", "bent_guide:joint1:big"], "'big' is no number"),
        ([FILE, "--speed", "9"], "speed 9: must be"),
        ([FILE, "--motion", "no.csv"], "no.csv: no such file"),
        ([FILE, "--truth", "no.yaml"], "no.yaml: no such file"),
        ([FILE, "--workdir", FILE], "is no directory"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(arguments, says):
    result = CliRunner().invoke(APP, ["simulate", *arguments])
    assert result.exit_code == 2
    assert says in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.slow
def test_a_run_says_where_things_are_and_ends_on_a_signal(tmp_path):
    machine, _ = default_machine()
    write_motion(tmp_path / "swing.csv", random_motion(machine, np.random.default_rng(0), 2.0))
    program = "import typer, sim_backends.cli as c; a = typer.Typer(); c.register(a); a()"
    command = [sys.executable, "-c", program, FILE, "--motion", str(tmp_path / "swing.csv")]
    command += ["--workdir", str(tmp_path / "run"), "--undeclared", "bent_guide:joint1:30"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        said = [process.stdout.readline() for _ in range(4)]
        assert said[0].split()[-1] == str(tmp_path / "run" / "machine.yaml")
        assert load_machine(tmp_path / "run" / "machine.yaml").simulation is not None
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=20) == 0
    left = list((tmp_path / "run").rglob("swing.csv"))
    assert len(left) == 1, "taken or still in the inbox, never both"


def test_plant_parameters_are_read_back_as_written(tmp_path):
    _, truth = default_machine()
    (tmp_path / "truth.yaml").write_text(truth_to_yaml(truth))
    assert load_truth(tmp_path / "truth.yaml") == truth
