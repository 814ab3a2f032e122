"""The benchmark of mistakes: rigs as described, mistakes that change something, judging by the first finding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.mistakes import MISTAKES
from benchmarks.mistakes.making import Made
from benchmarks.mistakes.rigs import Kind, make_rig
from benchmarks.mistakes.running import Line, checks_of, judge, rightly
from fitting.checks.findings import Finding

pytestmark = pytest.mark.slow


def made(*joints: str) -> Made:
    rig = make_rig("one", 1)
    return Made(rig, rig.machine, frozenset({"unit"}), frozenset(joints), (), {})


def test_only_the_first_mistake_counts_and_notes_do_not() -> None:
    right, other = Finding("unit", "", "", joint="joint1"), Finding("sign", "", "", joint="joint1")
    note = Finding("parked", "", "", severity="note")
    assert rightly([note, right, other], made("joint1")) == "right"
    assert rightly([other, right], made("joint1")) == "wrong"
    assert rightly([right], made("joint2")) == "wrong"
    assert rightly([note], made("joint1")) == "silent"
    told = Finding("unit", "", "", joint="joint1", severity="note")
    assert rightly([told], made("joint1")) == "note"


def test_there_are_thirty_mistakes_and_each_changes_what_is_on_disk() -> None:
    assert len(MISTAKES) >= 30
    rig = make_rig("both", 3)
    for number, (name, mistake) in enumerate(MISTAKES.items()):
        own = mistake(rig, np.random.default_rng(number))
        if own is None:
            continue
        same = own.rig.tables.keys() == rig.tables.keys() and all(
            len(own.rig.tables[s][c]) == len(rig.tables[s][c])
            and np.array_equal(own.rig.tables[s][c], rig.tables[s][c])
            for s in rig.tables
            for c in rig.tables[s]
        )
        assert not same or own.machine != rig.machine or own.roles, name


def test_a_rig_of_one_sensor_has_one(tmp_path: Path) -> None:
    rig = make_rig("single", 5)
    positions = [c.quantity for c in rig.machine.channels if c.quantity.endswith("_position")]
    assert len(positions) == len(rig.names) and len(set(positions)) == 1


def test_a_mistake_and_a_sound_rig_from_end_to_end(tmp_path: Path) -> None:
    rig = make_rig("one", 2)
    line = judge(rig, 2, "time in ms", 0, tmp_path / "mistake")
    assert line is not None and line.result == "right" and "milliseconds" in line.reported
    sound = judge(rig, 2, None, 0, tmp_path / "sound")
    assert sound is not None and sound.result == "sound"


def test_a_missed_mistake_and_a_false_accusation_miss_their_targets() -> None:
    lines = [Line("one-0", "a", None, "silent", "", 0.1), Line("one-1", None, None, "accused", "", 0.1)]
    met = {check.name: check.met for check in checks_of(lines)}
    assert met["mistakes: silent"] is False and met["sound ones: accused"] is False
    assert met["sound ones: refused"] is True


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        # Effects and quiet sensors that resemble mistakes: another joint's push, valves, friction by pressure, rests.
        ("single", 8_205_086),
        ("both", 8_205_106),
        ("both", 8_205_187),
        ("single", 7_205_179),
        ("one", 6_205_030),
        ("single", 8_205_023),
        ("both", 9_205_166),
        ("both", 9_205_199),
        ("one", 520_805_054),
    ],
)
def test_an_effect_that_resembles_a_mistake_is_not_reported_as_one(kind: Kind, seed: int, tmp_path: Path) -> None:
    line = judge(make_rig(kind, seed, effect=True), seed, None, 0, tmp_path / "sound")
    assert line is not None and line.result == "sound", line
