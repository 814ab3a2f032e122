"""Which names a case's data cannot tell from the true effect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.attribution import apart as separability
from benchmarks.attribution.apart import TELLABLE, apart
from benchmarks.attribution.making import BenchCase, TrueEffect
from benchmarks.attribution.recipe import CaseKey, Selection, opened
from benchmarks.attribution.sight import FITTED, Sight
from benchmarks.attribution.summary import inseparable, untellable
from sim_backends.undeclared import EffectSpec

KEY, SHORT = CaseKey("large", 2), Selection(arms=("slewing",), seconds=30.0)


def case_with(effect: str, joint: str, size: float) -> BenchCase:
    """A case of that effect; its recordings are made by :func:`apart` itself."""
    _, plan, quality = opened(KEY, SHORT)
    true = TrueEffect(effect, joint, size, 0.0, joint)
    return BenchCase(KEY, plan.machine, {}, plan.truth, quality, (true,), ())


@pytest.mark.slow
def test_an_offset_is_no_farther_from_its_own_name_than_from_the_truth() -> None:
    found = apart(case_with("pressure_offset", "joint2", 2.0e4), SHORT).rivals
    near = {(r.id, r.joint): r.beyond for r in found}
    # One column, and the plant's waveform is exactly that column.
    assert near["pressure_offset", "joint2"] < 0.5
    assert near["stribeck", "joint2"] > TELLABLE
    assert [r.beyond for r in found] == sorted(r.beyond for r in found)
    assert {r.joint for r in found} <= {"joint2", None} | {r.joint for r in found if r.id == "structural_flexibility"}


@pytest.mark.slow
def test_lambda_is_what_no_rival_explains() -> None:
    case = case_with("bent_guide", "joint3", 60.0)
    found = apart(case, SHORT)
    _, plan, quality = opened(KEY, SHORT)
    bare, there = (
        {stem: plan.record(stem, effects, quality)[1] for stem in FITTED}
        for effects in ((), (EffectSpec("bent_guide", "joint3", 60.0),))
    )
    lam = Sight(plan.machine, plan.truth, quality, bare).force(there)
    # On a light joint positions add little noise; the spectra differ, one is a formula, one is two minutes of data.
    assert found.seen == pytest.approx(lam, rel=0.3)
    assert 0 < found.rivals[0].beyond < found.rivals[-1].beyond <= found.seen


def test_pairs_and_encoder_errors_have_no_rivals() -> None:
    one = case_with("stribeck", "joint1", 10.0)
    assert apart(replace(one, effects=one.effects * 2), SHORT) is None
    assert apart(replace(one, effects=()), SHORT) is None
    assert apart(case_with("encoder_offset", "joint1", 1e-3), SHORT) is None


def test_the_distance_from_rivals_is_stored_beside_a_cached_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = case_with("encoder_offset", "joint1", 1e-3)
    (tmp_path / f"seed0-large-0002{SHORT.text}").mkdir()
    assert separability.stored_apart(tmp_path, case, SHORT) is None

    def again(*_: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(separability, "apart", again)
    assert separability.stored_apart(tmp_path, case, SHORT) is None


def line(sets: list[list[list[str]]], beyond: float) -> dict[str, object]:
    effect = {"id": "quadratic_loss", "joint": "joint1", "reported": "joint1", "seen": 12.0}
    near = [
        {"id": "quadratic_loss", "joint": "joint1", "beyond": 0.4},
        {"id": "velocity_root_friction", "joint": "joint1", "beyond": beyond},
    ]
    return {
        "kind": "large",
        "number": 0,
        "effects": [effect],
        "apart": {"seen": 11.0, "rivals": near},
        "said": {"sets": sets, "laws": []},
    }


def test_inseparable_pairs_are_named_with_how_they_were_said() -> None:
    true, other = ["quadratic_loss", "joint1"], ["velocity_root_friction", "joint1"]
    assert untellable(line([], 5.0)) == []
    rows = inseparable([line([[true, other]], 1.0), line([[true]], 2.0), line([[other]], 2.2), line([], 5.0)])
    assert len(rows) == 1
    assert rows[0].startswith("quadratic_loss | velocity_root_friction: 3 cases, apart by 2.0 in the median")
    assert all(text in rows[0] for text in ("both in a set 1", "the true one 1", "the other 1"))
    assert np.isfinite(TELLABLE)
