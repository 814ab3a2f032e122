"""Messages: sentences that keep their code and values, wherever they go, and are worded anew in other languages."""

from __future__ import annotations

import copy
import json
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.errors import InputError
from daq.messages import Sentence, message_from_json, messages_in, numerals, placeholders, with_messages

RATE = Sentence(
    "daq.time_sampled_hz_machine",
    path="a.csv",
    rate=49.5,
    rate_hz=np.float64(50.0),
    cure=Sentence("daq.if_time_counts_milliseconds"),
)


def test_it_is_its_english_sentence_and_german_by_its_code() -> None:
    assert RATE == (
        "a.csv: time: sampled at 49.5 Hz, the machine file says rate_hz 50; "
        "if time counts milliseconds call the column 'time [ms]'"
    )
    assert RATE.worded("de") == (
        "a.csv: time: abgetastet mit 49,5 Hz, die Maschinendatei sagt rate_hz 50; "
        "wenn time Millisekunden zählt, die Spalte „time [ms]“ nennen"
    )
    assert (RATE.worded("en"), RATE.upper()) == (RATE, str(RATE).upper())


def test_lists_are_joined_and_names_are_no_words() -> None:
    seen = Sentence("fitting.in_lines", file="arm 1.5.yaml", lines=["39", "43"])
    assert (seen, seen.worded("de")) == (" in arm 1.5.yaml lines 39 and 43", " in arm 1.5.yaml, Zeilen 39 und 43")
    named = Sentence("daq.named", name="stroke", what="stroke 2.5")
    assert named.worded("de") == "stroke: stroke 2,5", "the name stays, a number has its sign"


def test_it_keeps_code_and_values_through_errors_copies_files_and_sums() -> None:
    error = InputError("daq.time_sampled_hz_machine", **RATE.values)
    assert str(error) == RATE and isinstance(str(error), Sentence)
    for other in (str(error), copy.deepcopy(RATE), pickle.loads(pickle.dumps(RATE))):
        assert (other, other.to_json()) == (RATE, RATE.to_json())
    assert message_from_json(json.loads(json.dumps(RATE.to_json()))).worded("de") == RATE.worded("de")
    both = "Note: " + RATE + "."
    assert both == f"Note: {RATE}." and both.worded("de") == f"Note: {RATE.worded('de')}."
    assert RATE + "" is RATE


def test_a_plain_line_is_no_message_and_a_wrong_code_or_value_is_refused() -> None:
    assert type(str(InputError("a.csv is no recording"))) is str
    assert str(InputError("daq.nobody_has_this_key")) == "daq.nobody_has_this_key"
    with pytest.raises(KeyError, match="nobody_has"):
        Sentence("daq.nobody_has_this_key")
    with pytest.raises(KeyError, match="cure"):
        Sentence("daq.time_sampled_hz_machine", path="a", rate=1.0, rate_hz=1.0)
    assert placeholders("daq.time_sampled_hz_machine") == ("path", "rate", "rate_hz", "cure")


def _sentences(of: st.SearchStrategy[object]) -> st.SearchStrategy[object]:
    return st.builds(lambda name, what: Sentence("daq.named", name=name, what=what), st.text(max_size=8), of)


LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8)
CONTENT = st.recursive(
    LEAVES | _sentences(LEAVES | _sentences(LEAVES)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
)


def test_a_key_may_be_a_message() -> None:
    content = {Sentence("fitting.other_joint", joint="joint3"): {"value": 2.0}}
    back = with_messages(json.loads(json.dumps(content)), messages_in(content))
    assert [key.worded("de") for key in back] == ["anderes Gelenk: joint3"]


@given(CONTENT)
def test_messages_come_back_into_stored_content(content: object) -> None:
    stored, messages = json.loads(json.dumps([content, messages_in(content)]))
    back = with_messages(stored, messages)
    assert back == stored and messages_in(back) == messages


@given(st.text(max_size=30))
def test_a_language_changes_numbers_alone(text: str) -> None:
    assert len(numerals(text, "de")) == len(text) and numerals(text, "en") == text
    changed = [(a, b) for a, b in zip(text, numerals(text, "de"), strict=True) if a != b]
    assert set(changed) <= {(".", ",")}


def test_a_package_of_ones_own_has_its_texts_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "hilfit_test_effects"
    (package / "texts").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    for language, text in (("en", "a wiper that drags by {force:.1f} N"), ("de", "Abstreifer, {force:.1f} N")):
        content = {"messages": {"wiper": text}, "words": {}}
        (package / "texts" / f"{language}.json").write_text(json.dumps(content))
    monkeypatch.syspath_prepend(tmp_path)
    title = Sentence("hilfit_test_effects.wiper", force=2.5)
    found = messages_in([Sentence("daq.named", name="joint2", what=title), RATE])
    assert found["joint2: a wiper that drags by 2.5 N"]["worded"] == {"de": "joint2: Abstreifer, 2,5 N"}
    assert "worded" not in found[str(RATE)], "pages have the texts of this product"
    monkeypatch.delitem(sys.modules, "hilfit_test_effects", raising=False)
