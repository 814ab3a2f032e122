"""``hilfit excite``: files written, limits said, one line for what is wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
from arm_examples import driven_arm
from synthetic_arm import make_recordings, planar_machine, truth
from typer.testing import CliRunner

from daq.machine.machine_file import Hydraulics, machine_to_yaml
from daq.motion_files import read_motion
from daq.recordings.recording import read_recording, write_recording
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.linkage import lever_arm
from fitting.commands.excite_command import register
from fitting.excitation.design import information_of, information_of_recording
from fitting.excitation.objective import condition_of_information


@pytest.fixture
def run(tmp_path):
    app = typer.Typer()

    @app.callback()
    def main() -> None:
        """A group, as the real command line is."""

    register(app)
    (tmp_path / "machine.yaml").write_text(machine_to_yaml(driven_arm(2)))

    def call(*arguments: str):
        return CliRunner().invoke(app, ["excite", str(tmp_path / "machine.yaml"), *arguments])

    return call


@pytest.mark.slow
def test_command_writes_a_motion_and_says_what_it_uses(run, tmp_path):
    out = tmp_path / "m.csv"
    result = run("-o", str(out), "--seconds", "8", "--starts", "1", "--json")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    motion = read_motion(out, driven_arm(2))
    assert report["rods"] == motion.rods == "pinned"
    assert report["base_parameters"] == 6
    assert {use["quantity"] for use in report["limits"]} == {"position", "velocity", "acceleration", "stroke"}
    second = run("-o", str(tmp_path / "n.csv"), "--seconds", "8", "--starts", "1", "--json", "--after", str(out))
    assert json.loads(second.stdout)["condition_number"] < json.loads(second.stdout)["own_condition_number"]
    table = run("-o", str(out), "--seconds", "8", "--starts", "1", "--joint", "joint2")
    assert table.exit_code == 0
    assert "cond(W)" in table.output
    assert "cannot tell: ZZ1" in table.output


def test_command_for_free_cylinders(run, tmp_path):
    out = tmp_path / "m.csv"
    result = run("-o", str(out), "--unpinned", "--seconds", "15", "--starts", "1", "--json")
    assert result.exit_code == 0, result.output
    assert set(json.loads(result.stdout)["condition_numbers"]) == {"joint1", "joint2"}
    assert read_motion(out, driven_arm(2)).rods == "unpinned"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--joint", "joint9"], "joint 'joint9'"),
        (["--seconds", "2"], "fewer than two periods"),
        (["--unpinned", "--max-pressure", "10"], "free cylinders carry no load"),
        (["--unpinned", "--count", "2"], "free cylinders carry no load"),
        (["--after", "none.csv"], "none.csv: cannot be read"),
        (["--parameters", "none.json"], "none.json"),
        (["--criterion", "trace"], "write condition or determinant"),
        (["--experiment", "staircase"], "give one --joint"),
        (["--experiment", "jumps", "--joint", "joint1"], "experiment 'jumps': there are staircase"),
        (["--max-pressure", "1"], "however small the motion"),
        (["--seconds", "inf"], "'--seconds'"),
        (["--max-frequency", "1e9"], "'--max-frequency'"),
        (["--seed", "-1"], "'--seed'"),
    ],
)
@pytest.mark.slow
def test_command_ends_with_2_and_one_line_and_writes_nothing(run, tmp_path, arguments, says):
    result = run("-o", str(tmp_path / "m.csv"), *arguments)
    assert result.exit_code == 2
    assert says in result.stderr
    assert not (tmp_path / "m.csv").exists()


SHORT = ("--seconds", "8", "--starts", "1", "--json")


@pytest.mark.slow
def test_command_keeps_the_supply_of_the_machine_file(run, tmp_path):
    """Limits in the machine file count without being asked for; options take their place."""
    content = driven_arm(2).model_copy(
        update={"hydraulics": Hydraulics(supply_pressure=20e6, tank_pressure=2e5, pump_flow=2e-4)}
    )
    (tmp_path / "machine.yaml").write_text(machine_to_yaml(content))
    report = json.loads(run("-o", str(tmp_path / "m.csv"), *SHORT).stdout)
    used = {use["quantity"]: use for use in report["limits"]}
    assert used["flow"]["limit"] == pytest.approx(2e-4)
    assert used["pressure"]["limit"] == pytest.approx(20e6)
    assert used["flow"]["used"] <= 0.95 + 1e-6
    assert any("a guess" in note for note in report["notes"])
    report = json.loads(run("-o", str(tmp_path / "m.csv"), *SHORT, "--max-flow", "9", "--max-pressure", "150").stdout)
    used = {use["quantity"]: use for use in report["limits"]}
    assert used["flow"]["limit"] == pytest.approx(9e-3 / 60)
    assert used["pressure"]["limit"] == pytest.approx(15e6)


def test_command_says_where_limits_are_missing(run, tmp_path):
    report = json.loads(run("-o", str(tmp_path / "m.csv"), *SHORT).stdout)
    assert len(report["notes"]) == 2
    assert all("hydraulics." in note for note in report["notes"])


@pytest.mark.slow
def test_command_takes_parameters_from_a_report(run, tmp_path):
    """Pressures are then those of the identified arm, not of the guess."""
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    values = base.from_standard(np.tile([20, -7, 0, 0, 0.1, 0, 0, 3.0, 0, 3.0], 2))
    drive = {"m": 5.0, "K": 0.0, "f_c": 300.0, "f_v": 0.0, "f_s": 0.0}
    content = {
        "schema": "hilfit/report/1",
        "rigid_body": {
            "parameters": [
                {"expression": expression, "value": value, "std": 0.1, "unit": unit}
                for expression, value, unit in zip(base.expressions, values.tolist(), base.units, strict=True)
            ]
        },
        "cylinders": {
            joint.name: {
                "parameters": {name: {"value": value} for name, value in drive.items()},
                "residual_std": 10.0,
            }
            for joint in machine.joints
        },
    }
    (tmp_path / "report.json").write_text(json.dumps(content))
    arguments = ("-o", str(tmp_path / "m.csv"), *SHORT, "--max-pressure", "200")
    report = json.loads(run(*arguments, "--parameters", str(tmp_path / "report.json")).stdout)
    assert any("as identified in" in note for note in report["notes"])
    q = read_motion(tmp_path / "m.csv", machine).joint_positions(machine)
    time = np.arange(len(q)) / machine.rate_hz
    qd = np.gradient(q, time, axis=0)
    tau = base_regressor(machine, base, q, qd, np.gradient(qd, time, axis=0)) @ values
    for i, joint in enumerate(machine.joints):
        force = np.abs(tau[:, i] / lever_arm(joint.cylinder.linkage, q[:, i])).max()
        reached = next(
            u["reached"] for u in report["limits"] if (u["joint"], u["quantity"]) == (joint.name, "pressure")
        )
        # At least the load over the bore, at most load and friction (with the mass's share) over the ring.
        assert force / joint.cylinder.head_area < reached < (force + 300.0 + 10.0) / joint.cylinder.rod_area


@pytest.mark.slow
def test_command_makes_several_motions_that_complement_each_other(run, tmp_path):
    report = json.loads(run("-o", str(tmp_path / "m.csv"), *SHORT, "--count", "2").stdout)
    files = [motion["file"] for motion in report["motions"]]
    assert files == [str(tmp_path / "m-1.csv"), str(tmp_path / "m-2.csv")]
    first, second = report["motions"]
    assert second["condition_number"] < min(first["condition_number"], second["own_condition_number"])
    machine = driven_arm(2)
    base = reduce_parameters(machine)
    both = sum(information_of(machine, base, read_motion(path, machine)) for path in files)
    assert second["condition_number"] == pytest.approx(condition_of_information(both), rel=1e-2)


@pytest.fixture
def recorded(run, tmp_path):
    """The machine file is that of recordings now: one of training with joint 1 parked, and one of free cylinders."""
    machine = planar_machine(2)
    (tmp_path / "machine.yaml").write_text(machine_to_yaml(machine))
    made = make_recordings(machine, truth(2), [("train", 2), ("unloaded", 3)], moving=[1])
    for name, recording in zip(("parked", "free"), made, strict=True):
        values = dict(recording.values)
        parked = machine.channel("joint_position", "joint1")
        if name == "parked" and parked is not None:  # an encoder that shows no noise is still no broken one
            values[parked.name] = np.full(len(recording), values[parked.name][0])
        role = "operation" if name == "parked" else recording.role
        write_recording(tmp_path / f"{name}.parquet", machine, role, recording.time, values)
    return machine


@pytest.mark.slow
def test_command_counts_what_recordings_have_gathered(run, recorded, tmp_path):
    """The new motion is weighed together with the recording, in whatever role that was made."""
    out = tmp_path / "m.csv"
    report = json.loads(run("-o", str(out), *SHORT, "--gathered", str(tmp_path / "parked.parquet")).stdout)
    base = reduce_parameters(recorded)
    recording = read_recording(tmp_path / "parked.parquet", recorded, "operation")
    own = information_of(recorded, base, read_motion(out, recorded))
    together = condition_of_information(own + information_of_recording(recorded, base, recording))
    assert report["condition_number"] == pytest.approx(together, rel=1e-2)
    assert report["own_condition_number"] == pytest.approx(condition_of_information(own), rel=1e-2)
    # The choice itself is another one than without the recording.
    alone = json.loads(run("-o", str(tmp_path / "n.csv"), *SHORT).stdout)
    assert report["condition_number"] < alone["condition_number"] < report["own_condition_number"]


@pytest.mark.slow
def test_command_takes_a_recording_of_free_cylinders_for_the_forecast_only(run, recorded, tmp_path):
    arguments = ("-o", str(tmp_path / "m.csv"), *SHORT, "--gathered", str(tmp_path / "free.parquet"))
    result = run(*arguments)
    assert result.exit_code == 2
    assert "free.parquet: was recorded with rods unpinned" in result.stderr
    result = run(*arguments, "--effects")
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["condition_number"] == report["own_condition_number"]
    alone = json.loads(run("-o", str(tmp_path / "n.csv"), *SHORT, "--effects").stdout)

    def std(forecast):
        return {entry["name"]: entry["std"] for entry in forecast["parameters"]}

    before, after = std(alone["forecast"]), std(report["forecast"])
    assert after["joint1.f_c"] < 0.9 * before["joint1.f_c"]


def test_command_makes_an_experiment(run, tmp_path):
    out = tmp_path / "m.csv"
    result = run("-o", str(out), "--experiment", "staircase", "--joint", "joint2", "--seconds", "30")
    assert result.exit_code == 0, result.output
    assert "a staircase of constant speeds of joint2" in result.output
    motion = read_motion(out, driven_arm(2))
    assert np.ptp(motion.columns["joint1"]) == 0
    assert np.ptp(motion.columns["joint2"]) > 0.5
    limits = json.loads(run("-o", str(out), "--experiment", "staircase", "--joint", "joint2", "--json").stdout)[
        "limits"
    ]
    assert {use["joint"] for use in limits} == {"joint2"}


@pytest.mark.slow
def test_command_forecasts_effects_and_parameters(run, tmp_path):
    """A motion of one joint shows that joint's effects, and says that it tells nothing of the other's friction."""
    arguments = ("-o", str(tmp_path / "m.csv"), "--seconds", "15", "--starts", "1", "--joint", "joint2", "--effects")
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.output
    forecast = json.loads(result.stdout)["forecast"]
    seen = {(entry["id"], entry["joint"]): entry for entry in forecast["effects"]}
    assert seen[("position_dependent_friction", "joint2")]["smallest"] > 0
    assert seen[("position_dependent_friction", "joint2")]["surviving"] > 0.3
    assert seen[("position_dependent_friction", "joint1")]["smallest"] is None
    verdicts = {entry["name"]: entry["verdict"] for entry in forecast["parameters"]}
    assert verdicts["joint1.f_c"] == "not told"
    assert "a guess" in forecast["basis"]
    # Joint 1 rests mid-range, where friction that follows its pose is a column of rounding errors.
    assert seen[("pose_dependent_friction", "joint2")]["smallest"] is None
    text = run(*arguments)
    assert "smallest effect that will be found with 95 % probability" in text.output
    assert "position_dependent_friction" in text.output
    assert "this motion tells" in text.output


@pytest.mark.slow
def test_command_forecasts_with_what_is_there_already(run, tmp_path):
    """Free cylinders beside the planned motion: friction that goes with the load is told from plain friction."""
    free, out = tmp_path / "free.csv", tmp_path / "m.csv"
    assert run("-o", str(free), "--unpinned", "--seconds", "20", "--starts", "1").exit_code == 0
    shares = []
    for after in ((), ("--after", str(free))):
        result = run("-o", str(out), "--experiment", "frequencies", "--joint", "joint1", "--effects", "--json", *after)
        assert result.exit_code == 0, result.output
        entries = json.loads(result.stdout)["forecast"]["effects"]
        shares.append(
            next(e["surviving"] for e in entries if (e["id"], e["joint"]) == ("load_dependent_friction", "joint1"))
        )
    assert shares[1] > 2 * shares[0]
