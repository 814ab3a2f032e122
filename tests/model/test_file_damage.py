"""A model's file that somebody changed: one line for every kind of damage, whatever it is."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from model_examples import law_of, model_with, session_of, term_of

from daq.errors import InputError
from fitting.model.codec import load_model, model_from_json, model_schema, model_to_json

SESSION = session_of(2)
MODEL = model_with([term_of(SESSION, "presliding_hysteresis", 1), law_of(SESSION, "piston_position", 0)], SESSION)
CONTENT: dict[str, Any] = json.loads(json.dumps(model_to_json(MODEL)))
ROOT = Path(__file__).parents[2]


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths to every kind of thing in the file: all keys, and the first and last entry of lists."""
    found = [path] if path else []
    if isinstance(value, dict):
        for key, own in value.items():
            found += places(own, (*path, key))
    elif isinstance(value, list) and value:
        for number in {0, len(value) - 1}:
            found += places(value[number], (*path, number))
    return found


# The list of parameters is for people, and what a recording or a program is called is not calculated with.
PLACES = [own for own in places(CONTENT) if own[0] not in ("parameters", "sha256")]
DAMAGES = (None, -1, -1e300, 1e300, 0, "", "x", [], {}, [[]], True, float("nan"), float("inf"), [None], 7.5, {"a": 1})


def damaged(path: tuple[Any, ...], value: Any, *, gone: bool, checked: bool) -> dict[str, Any]:
    content = copy.deepcopy(CONTENT)
    place = content
    for key in path[:-1]:
        place = place[key]
    if gone:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    if not checked:
        del content["sha256"]
    return content


@pytest.mark.slow
@given(st.sampled_from(PLACES), st.sampled_from(DAMAGES), st.booleans(), st.booleans())
@settings(max_examples=400, deadline=None)
def test_every_damage_is_refused_in_one_line_or_does_not_matter(
    path: tuple[Any, ...], value: Any, gone: bool, checked: bool
) -> None:
    content = damaged(path, value, gone=gone, checked=checked)
    try:
        model = model_from_json(content, "arm/model.json")
    except InputError as error:
        text = str(error)
        assert text.startswith("arm/model.json: ") and "\n" not in text
        assert "identify again" in text or "update hilfit" in text or "install" in text or "give the model" in text
    else:
        # Without the checksum a change may be a valid model, which then can be calculated with and written again.
        assert not checked or content == CONTENT or path[:2] == ("provenance", "calibration")
        model_from_json(json.loads(json.dumps(model_to_json(model), allow_nan=False)))


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("covariance", 0, 0), -1.0, "covariance: is none: it has a negative variance"),
        (("covariance", 0, 1), 1e9, "covariance: is none"),
        (("residual_std", 0), float("nan"), "residual_std.0"),
        (("passes", 0, "theta", 0), float("inf"), "passes.0.theta.0"),
        (("position_noise", 0, "speed"), -1e-3, "position_noise: is below zero"),
        (("base", "independent", 0), 4000, "base.independent"),
        (("terms", 0, "joint"), 7, "terms.0.joint: is 7, the machine has 2 joints"),
        (("terms", 0, "shape"), 3, "terms.0"),
        (("passes", -1, "theta", 2), 1.0, "sha256: the file was changed after it was written"),
    ],
)
def test_a_damage_is_named(path: tuple[Any, ...], value: Any, words: str) -> None:
    with pytest.raises(InputError) as caught:
        model_from_json(damaged(path, value, gone=False, checked=True), "m")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_service_may_add_its_calibration() -> None:
    content = copy.deepcopy(CONTENT)
    content["provenance"]["calibration"] = "c-7"
    content |= {"calibration": "c-7", "state": "active"}
    assert model_from_json(content).provenance.calibration == "c-7"


def test_an_older_file_without_the_newer_keys_is_read(tmp_path: Path) -> None:
    old = {k: v for k, v in CONTENT.items() if k not in ("sha256", "rests", "seen", "hidden", "errors", "coverage")}
    (tmp_path / "model.json").write_text(json.dumps(old), encoding="utf-8")
    assert load_model(tmp_path).rests == ()


def test_rests_and_what_was_seen_come_back() -> None:
    again = model_from_json(CONTENT)
    assert model_to_json(again) == CONTENT and len(again.rests) == len(MODEL.rests) == 1
    assert again.seen is not None and 50 < len(again.seen.q) <= 240


def test_an_unknown_format_is_refused_in_one_line(tmp_path: Path) -> None:
    from fitting.model.export import export_model

    with pytest.raises(InputError, match="there is no format 'magic'; use one of c, csv, fmu"):
        export_model(MODEL, "magic", tmp_path / "x")


def test_the_published_schema_is_that_of_the_file() -> None:
    assert json.loads((ROOT / "docs" / "model.schema.json").read_text(encoding="utf-8")) == model_schema()
    assert set(model_schema()["required"]) <= set(CONTENT)
