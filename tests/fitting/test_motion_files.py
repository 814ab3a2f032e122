"""Motion files come back as they were written, and a wrong one is refused with one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arm_examples import driven_arm

from daq.errors import InputError
from daq.motion_files import Motion, read_motion, write_motion

TIME = np.arange(10) * 0.02


def pinned() -> Motion:
    return Motion("test-arm", "pinned", TIME, {"joint1": 0.1 * TIME, "joint2": np.full(10, 0.2)})


def test_pinned_motion_comes_back(tmp_path):
    write_motion(tmp_path / "m.csv", pinned())
    lines = (tmp_path / "m.csv").read_text().splitlines()
    assert lines[0] == "# hilfit/motion/1 machine=test-arm rods=pinned"
    assert lines[1] == "time,joint1,joint2"
    found = read_motion(tmp_path / "m.csv", driven_arm(2))
    assert (found.machine, found.rods, list(found.columns)) == ("test-arm", "pinned", ["joint1", "joint2"])
    np.testing.assert_allclose(found.time, TIME, atol=1e-12)
    np.testing.assert_allclose(found.columns["joint1"], 0.1 * TIME, atol=1e-12)
    assert found.seconds == pytest.approx(0.18)


def test_unpinned_columns_are_pistons(tmp_path):
    motion = Motion("test-arm", "unpinned", TIME, {"joint2": 0.1 + 0.1 * TIME})
    write_motion(tmp_path / "m.csv", motion)
    assert (tmp_path / "m.csv").read_text().splitlines()[1] == "time,joint2.piston"
    assert list(read_motion(tmp_path / "m.csv", driven_arm(2)).columns) == ["joint2"]


def test_the_simulated_controller_reads_the_same_file(tmp_path):
    from sim_backends.plant.motion import read_motion as read_in_controller

    machine = driven_arm(2)
    for motion in (pinned(), Motion("test-arm", "unpinned", TIME, {"joint2": 0.1 + 0.1 * TIME})):
        write_motion(tmp_path / "m.csv", motion)
        found = read_in_controller(tmp_path / "m.csv", machine)
        assert found.rods == motion.rods
        assert list(found.joints) == list(motion.columns)
        np.testing.assert_allclose(found.positions.T, list(motion.columns.values()), atol=1e-9)


def test_joints_without_a_column_hold():
    positions = pinned().joint_positions(driven_arm(3))
    np.testing.assert_array_equal(positions[:, 2], 0.0)
    np.testing.assert_allclose(positions[:, 0], 0.1 * TIME)


HEAD = "# hilfit/motion/1 machine=test-arm rods=pinned\n"
ROWS = "".join(f"{0.02 * k},0.1\n" for k in range(8))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not a motion file"),
        ("time,joint1\n0,0\n", "not a motion file"),
        ("# hilfit/motion/2 machine=test-arm rods=pinned\n", "not a motion file"),
        ("# hilfit/motion/1 machine=test-arm rods=loose\ntime,joint1\n" + ROWS, "rods is 'loose'"),
        (HEAD + "t,joint1\n" + ROWS, ":2: must name 'time'"),
        (HEAD + "time,joint1,joint1\n" + ROWS, ":2: must name 'time'"),
        (HEAD + "time,joint1\n0,0\n0.02,abc\n", ":4: not numbers: '0.02,abc'"),
        (HEAD + "time,joint1\n0,0\n0.02,0,1\n", ":4: has 3 values for 2 columns"),
        (HEAD + "time,joint1\n0,0\n0.02,0\n", "has 2 rows"),
        (HEAD + "time,joint1\n" + ROWS.replace("0.06,0.1", "0.06,nan"), ":6: holds a value that is not finite"),
        (HEAD + "time,joint1\n" + ROWS.replace("0.06,0.1", "0.01,0.1"), "time must start at 0, rise"),
        (HEAD + "time,joint1\n" + ROWS + "3601,0.1\n", "and end within an hour"),
        (HEAD + "time,joint1\n" + ROWS + "0.1400000001,0.1\n", "rise by a microsecond or more"),
        (HEAD + "time,joint9\n" + ROWS, "there is no joint 'joint9'"),
        (
            HEAD + "time,joint1\n" + ROWS.replace("0.06,0.1", "0.06,0.7"),
            "joint1 goes from 0.1 to 0.7 rad, beyond its -0.6",
        ),
        (HEAD.replace("test-arm", "other") + "time,joint1\n" + ROWS, "of machine 'other', not of 'test-arm'"),
        (HEAD.replace("pinned", "unpinned") + "time,joint1\n" + ROWS, "must end with '.piston'"),
    ],
)
def test_wrong_files_are_refused_in_one_line(tmp_path, text, says):
    path = tmp_path / "m.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_motion(path, driven_arm(2))
    message = str(caught.value)
    assert says in message
    assert str(path) in message
    assert "\n" not in message


def test_a_mark_of_the_byte_order_is_no_part_of_the_first_line(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text(HEAD + "time,joint1\n" + ROWS, encoding="utf-8-sig")  # as editors of Windows save it
    assert read_motion(path, driven_arm(2)).machine == "test-arm"


def test_a_missing_file_and_a_place_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_motion(tmp_path / "none.csv")
    with pytest.raises(InputError, match="cannot be written"):
        write_motion(tmp_path / "no" / "folder" / "m.csv", pinned())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"m\.csv: cannot be written \(Not a directory\)"):
        write_motion(tmp_path / "file" / "m.csv", pinned())


def test_a_folder_that_may_not_be_touched_is_one_line(tmp_path, monkeypatch):
    """Also where looking for the unfinished file is refused."""
    from pathlib import Path

    def refused(self, *arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "write_bytes", refused)
    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(InputError, match=r"m\.csv: cannot be written \(Permission denied\); choose another place$"):
        write_motion(tmp_path / "m.csv", pinned())
    assert list(tmp_path.iterdir()) == []


def test_nothing_half_is_left_where_writing_fails(tmp_path, monkeypatch):
    from pathlib import Path

    def full(self, target):
        raise OSError(28, "No space left on device")

    (tmp_path / "m.csv").write_text("the old one")
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        write_motion(tmp_path / "m.csv", pinned())
    assert (tmp_path / "m.csv").read_text() == "the old one"
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]


def test_a_file_that_is_being_written_is_hidden(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A controller watches the folder and takes what it sees for a motion.
    seen: list[str] = []
    write_bytes = Path.write_bytes

    def watched(self: Path, content: bytes) -> int:
        seen.append(self.name)
        return write_bytes(self, content)

    monkeypatch.setattr(Path, "write_bytes", watched)
    write_motion(tmp_path / "a.csv", Motion("arm", "pinned", np.array([0.0, 0.02]), {"joint1": np.zeros(2)}))
    (name,) = seen
    assert name.startswith(".a.csv.")
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]
