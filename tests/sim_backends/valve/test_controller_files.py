"""Files of valve motions: what is written is read back, and what no controller should play is refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from daq.errors import InputError
from daq.valve_motions import Step, ValveAxis, ValveMotion, write_valve_motion
from sim_backends.valve.machines import default_crane
from sim_backends.valve.valve_process import is_valve_motion, read_valve_motion

MACHINE, _ = default_crane()
BOOM = ValveAxis("boom", 0.0, -100.0, -0.5, 0.5, 0.36, 0.08, 0.25, 0.75, 6.1)
MOTION = ValveMotion(
    "valve-crane",
    (BOOM,),
    (Step("go", 8.0, (0.125,)), Step("hold", 1.15, (45.5,)), Step("swing", 9.0, (-30.0,), 0.125)),
)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    write_valve_motion(path, MOTION)
    assert is_valve_motion(path) and read_valve_motion(path, MACHINE) == MOTION
    assert not is_valve_motion(tmp_path / "none.csv")


def test_a_share_of_full_is_upwards_whatever_the_amplifier_takes() -> None:
    assert BOOM.sent(0.5) == -50.0 and BOOM.share(BOOM.sent(0.3)) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("hilfit/valve-motion/1", "hilfit/motion/1", ":1: not a valve motion"),
        ("machine=valve-crane", "machine=digger", ":1: is a motion of machine 'digger'"),
        ("axis=boom", "axis=slew", ":2: valve-crane has no joint 'slew' with a cylinder.valve"),
        ("edge=0.08 ", "", ":2: an axis has NAME=NUMBER for each of axis, neutral"),
        ("rate=6.1", "rate=nan", ":2: holds a number that cannot be"),
        ("high=0.5 ", "high=0.6 ", ":2: holds a number that cannot be; the range of boom is -0.5 to 0.5"),
        ("hz,boom", "hz,jib", ":3: must name does, seconds, hz and then the axes"),
        ("hold,1.15,0,45.5", "jump,1.15,0,45.5", ":5: not a step: 'jump,1.15,0,45.5'"),
        ("hold,1.15,0,45.5", "hold,1.15,0,nan", ":5: not a step"),
        ("hold,1.15,0,45.5", "hold,1.15,0,75.1", ":5: boom is sent 75.1, more than 0.75 of full"),
        ("go,8,0,0.125", "go,8,0,0.51", ":4: boom is to go to 0.51, beyond -0.5 to 0.5"),
    ],
)
def test_what_no_controller_should_play_is_one_line(tmp_path: Path, old: str, new: str, says: str) -> None:
    path = tmp_path / "one.csv"
    write_valve_motion(path, MOTION)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_valve_motion(path, MACHINE)
    assert str(caught.value).startswith(f"{path}{says}") and "\n" not in str(caught.value)
