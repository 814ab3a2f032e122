"""Runs that are interrupted, continued, refused; and one small case from end to end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.attribution import making, runs, summary
from benchmarks.attribution.judging import Findings
from benchmarks.attribution.making import BenchCase, make_case
from benchmarks.attribution.recipe import (
    KINDS,
    RECIPE,
    RECIPES,
    CaseKey,
    Selection,
    draw_effect,
    draw_quality,
    generator,
    largest,
    opened,
)
from daq.errors import InputError
from sim_backends.machines import ARMS
from sim_backends.plant.cases import plan_case
from sim_backends.undeclared import OUTSIDE, UNDECLARED, obstacle

SHORT = Selection(seconds=20.0)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Cases that were really done; doing one takes no time."""
    done: list[str] = []

    def fake(order: runs.Order) -> dict[str, Any]:
        done.append(order.key.text)
        key = order.key
        selection = order.selection.as_json()
        return {"kind": key.kind, "number": key.number, "seed": key.seed, "selection": selection, "result": "right"}

    monkeypatch.setattr(runs, "run_case", fake)
    return done


def orders(*keys: CaseKey, selection: Selection | None = None) -> list[runs.Order]:
    return [runs.Order(key, selection or Selection(), None) for key in keys]


KEYS = (CaseKey("null", 0), CaseKey("null", 1), CaseKey("large", 0))


def test_a_run_goes_on_where_it_stopped(counted: list[str], tmp_path: Path) -> None:
    output = tmp_path / "results.jsonl"
    runs.run(orders(*KEYS[:2]), 1, output)
    with output.open("a") as file:
        file.write('{"kind": "large", "number": 0, "se')  # cut off by an interruption
    counted.clear()
    lines = runs.run(orders(*KEYS), 1, output)
    assert counted == ["large:0"]
    assert [runs.key_of(line) for line in lines] == list(KEYS)
    assert [runs.key_of(line) for line in runs.read_lines(output)] == list(KEYS)


def test_other_restrictions_do_not_continue_a_run(counted: list[str], tmp_path: Path) -> None:
    output = tmp_path / "results.jsonl"
    runs.run(orders(KEYS[0]), 1, output)
    with pytest.raises(InputError, match="null:0 from a run with other restrictions"):
        runs.run(orders(KEYS[0], selection=SHORT), 1, output)
    without = [replace(order, bootstrap=0) for order in orders(KEYS[0])]
    with pytest.raises(InputError, match="null:0 from a run with other restrictions"):
        runs.run(without, 1, output)


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    output = tmp_path / "notes.txt"
    output.write_text("hello\nworld\n")
    with pytest.raises(InputError, match="line 1 is no result"):
        runs.read_lines(output)


def test_classes_are_interleaved() -> None:
    plan = runs.plan_of({"null": 4, "large": 2}, 9)
    assert [key.text for key in plan] == ["null:0", "large:0", "null:1", "null:2", "large:1", "null:3"]
    assert {key.seed for key in plan} == {9}


def test_a_case_does_not_depend_on_what_else_is_run() -> None:
    first, again, other = (generator(CaseKey("large", n)).uniform() for n in (3, 3, 4))
    assert first == again != other
    assert len({generator(CaseKey(kind, 0)).uniform() for kind in KINDS}) == len(KINDS)


def test_qualities_differ_and_are_plausible() -> None:
    qualities = [draw_quality(np.random.default_rng(seed)) for seed in range(50)]
    assert 0.03 <= min(q.disturbance for q in qualities) < 0.05 < 0.2 < max(q.disturbance for q in qualities) <= 0.3
    assert len({q.piston_resolution for q in qualities}) == 4


@pytest.mark.parametrize("arm", list(ARMS))
def test_every_effect_has_a_largest_size_on_every_joint(arm: Any) -> None:
    plan = plan_case(arm, 3, seconds=20.0)
    for effect, kind in UNDECLARED.items():
        able = [joint.name for joint in plan.machine.joints if obstacle(kind, joint) is None]
        assert able
        for joint in [None] if kind.base_wide else able:
            assert largest(effect, plan, joint) > 0


# Drawn by the benchmark when recipe 3 was its only one: arm, and the effect and joint that were drawn first.
OF_RECIPE_3 = {
    ("large", 0, 0): ("folding-arm", "pose_dependent_friction", "joint4"),
    ("large", 0, 77): ("slewing-arm", "carried_liquid", "joint6"),
    ("kinematic", 1, 0): ("folding-arm", "linkage_geometry", "joint6"),
    ("outside", 0, 77): ("slewing-arm", "hanging_hose", "joint1"),
    ("outside", 2, 77): ("folding-arm", "saturating_coupling", "joint5"),
    ("outside", 3, 0): ("folding-arm", "return_line", "joint6"),
    ("pairs", 2, 0): ("slewing-arm", "pressure_gain", "joint1"),
}


@pytest.mark.parametrize("key", list(OF_RECIPE_3))
def test_the_third_recipe_still_makes_its_cases(key: tuple[str, int, int]) -> None:
    kind, number, seed = key
    selection = Selection(seconds=20.0, recipe=3)
    rng, plan, quality = opened(CaseKey(kind, number, seed), selection)
    effect, _ = draw_effect(rng, kind, plan, selection)
    assert (plan.machine.name, effect.id, effect.joint) == OF_RECIPE_3[key]
    assert quality.pressure_resolution in {25.0e6 / 2**bits for bits in (14, 15, 16)}


def test_recipes_stay_as_they_are() -> None:
    first = ("bent_guide", "threshold_spring", "neighbour_product_friction", "saturating_coupling", "dwell_stiction",
             "neighbour_inertia", "dented_rod", "return_line", "hanging_hose")  # fmt: skip
    later = ("squeezed_guide", "wiped_film", "lying_rod", "starved_inflow", "shared_gallery", "pilot_line")
    assert RECIPES[3].arms == ("folding", "slewing") and RECIPES[3].outside == first
    assert RECIPES[4].arms == ("folding", "slewing", "excavator", "telescope") and RECIPES[4].outside == first + later
    usual = ("encoder_offset", "linkage_geometry", "encoder_eccentricity", "backlash")
    assert set(RECIPES[3].kinematic) == set(RECIPES[4].kinematic) == set(usual)
    assert set(RECIPES[5].kinematic) > set(usual) and RECIPES[5].outside == first + later
    assert RECIPES[6] == replace(RECIPES[5], positions=True)
    assert RECIPE == 7 and RECIPES[7] == replace(RECIPES[6], lines=True)
    assert set(OUTSIDE) == set(first + later)


@pytest.mark.slow
def test_a_recipe_draws_all_of_its_arms_and_chosen_ones_take_turns() -> None:
    def arms(selection: Selection) -> list[str]:
        return [opened(CaseKey("null", n, 5), selection)[1].machine.name for n in range(24)]

    assert set(arms(Selection(seconds=20.0, recipe=3))) == {"folding-arm", "slewing-arm"}
    assert len(set(arms(Selection(seconds=20.0)))) == 4
    heavy = arms(Selection(seconds=20.0, arms=("telescope", "excavator")))
    assert heavy == ["telescopic-crane", "excavator-front"] * 12


def test_the_transducers_of_heavy_machines_end_at_400_bar() -> None:
    for arm, full in (("excavator", 400e5), ("folding", 250e5)):
        _, _, quality = opened(CaseKey("null", 0, 5), Selection(seconds=20.0, arms=(arm,)))
        assert quality.pressure_resolution in {full / 2**bits for bits in (14, 15, 16)}
        assert 2.0e-5 <= quality.pressure_std / full <= 2.0e-4


@pytest.mark.slow
def test_what_a_joint_cannot_have_is_drawn_again() -> None:
    selection = Selection(only="linkage_geometry", arms=("telescope",), seconds=20.0)
    case = make_case(CaseKey("kinematic", 2, 5), selection)
    assert case.effects[0].joint in ("boom", "knuckle")
    assert {r.joint for r in case.redrawn if "linkage" in r.why} <= {"slew", "telescope"}


@pytest.mark.slow
def test_effects_outside_the_catalogue_say_what_shows_them() -> None:
    assert set(OUTSIDE) >= {"bent_guide", "threshold_spring"}
    case = make_case(CaseKey("outside", 0), Selection(only="bent_guide", seconds=20.0))
    assert case.effects[0].variables == ("piston_position",)


def same(first: BenchCase, second: BenchCase) -> None:
    assert first.effects == second.effects and first.quality == second.quality and first.truth == second.truth
    assert list(first.recordings) == list(second.recordings)
    for stem, table in first.recordings.items():
        assert list(table) == list(second.recordings[stem])
        for name, column in table.items():
            np.testing.assert_array_equal(column, second.recordings[stem][name])


@pytest.mark.slow
def test_a_cached_case_is_the_case(tmp_path: Path) -> None:
    key = CaseKey("medium", 1, seed=4)
    made = making.stored_case(tmp_path, key, SHORT)
    same(made, making.stored_case(tmp_path, key, SHORT))
    same(made, make_case(key, SHORT))
    assert 5.2 < made.effects[0].seen < 11.3


@pytest.mark.slow
def test_an_unfinished_folder_of_the_cache_is_made_again(tmp_path: Path) -> None:
    key = CaseKey("null", 0)
    made = making.stored_case(tmp_path, key, SHORT)
    (place,) = tmp_path.iterdir()
    (place / "case.json").unlink()
    (place / "train-1.parquet").write_bytes(b"half")
    same(made, making.stored_case(tmp_path, key, SHORT))


@pytest.mark.slow
def test_both_effects_of_a_pair_have_the_shapes_and_sizes_that_were_asked_for() -> None:
    case = make_case(CaseKey("pairs", 0), SHORT)
    assert len(case.effects) == 2
    assert all(8.8 < effect.seen < 68 for effect in case.effects)
    assert len({(e.id, e.joint) for e in case.effects}) == 2


@pytest.mark.slow
def test_one_case_from_end_to_end_twice_alike(tmp_path: Path) -> None:
    order = runs.Order(CaseKey("null", 3), Selection(seconds=40.0, arms=("excavator",)), tmp_path)
    line = runs.run_case(order)
    assert line["result"] == "right", line
    assert json.loads(json.dumps(line)) == line
    assert len(line["parameters"]) > 40
    again = runs.run_case(order)
    assert again["said"] == line["said"] and again["parameters"] == line["parameters"]


@pytest.mark.slow
def test_what_the_fit_throws_is_a_result(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def broken(*_: Any) -> None:
        raise ZeroDivisionError("nothing to divide")

    monkeypatch.setattr(runs, "judge", broken)
    line = runs.run_case(runs.Order(CaseKey("null", 0), SHORT, tmp_path))
    assert (line["result"], line["error"]) == ("error", "ZeroDivisionError: nothing to divide")


def unsimulated() -> Any:
    return SimpleNamespace(
        machine=SimpleNamespace(name="arm", rate_hz=50.0),
        effects=(),
        quality=draw_quality(np.random.default_rng(1)),
        redrawn=(),
        recordings={f"{role}-1": {"time": [0.0, 0.02]} for role in ("unloaded", "train", "repeat", "validate")},
    )


def test_a_case_can_be_judged_at_several_bands(monkeypatch: pytest.MonkeyPatch) -> None:
    def judge(machine: Any, recordings: list[Any], bootstrap: int, bands: Any) -> Any:
        name = (("stribeck", "boom"),)
        return [Findings((), (), {}, depends=True), Findings((name,), (), {}), Findings((name,), (), {})][: len(bands)]

    monkeypatch.setattr(runs, "judge", judge)
    monkeypatch.setattr(runs, "make_case", lambda key, selection: unsimulated())
    line = runs.run_case(runs.Order(CaseKey("large", 0), Selection(), None, bands=(1.0, 0.7, 1.3)))
    assert line["result"] == "silent", "what counts is what is said at the own band"
    assert {band: said[0] for band, said in line["bands"].items()} == {
        "1": "nothing_missing", "0.7": "effect_added", "1.3": "effect_added"
    }  # fmt: skip
    shown = {check.name: check.measured for check in summary.checks([line])}
    assert shown["the same verdict at every band"] == 0
    assert shown["the same verdict, or said to depend on the band"] == 1
    assert "bands" not in runs.run_case(runs.Order(CaseKey("large", 0), Selection(), None))


def test_a_case_can_be_judged_without_the_recordings_of_a_role(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    judged: list[list[str]] = []

    def judge(machine: Any, recordings: list[Any], bootstrap: int, bands: Any) -> Any:
        judged.append([r.role for r in recordings])
        raise RuntimeError("enough")

    case = unsimulated()
    monkeypatch.setattr(runs, "judge", judge)
    monkeypatch.setattr(runs, "make_case", lambda key, selection: case)
    for role in (None, "repeat"):
        line = runs.run_case(runs.Order(KEYS[0], Selection(), None, without=role))
        assert line["without"] == role
    assert judged == [["unloaded", "train", "repeat", "validate"], ["unloaded", "train", "validate"]]
    output = tmp_path / "results.jsonl"
    output.write_text(json.dumps(line) + "\n")
    with pytest.raises(InputError, match="other restrictions"):
        runs.run([runs.Order(KEYS[0], Selection(), None)], 1, output)
