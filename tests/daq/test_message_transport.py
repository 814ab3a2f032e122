"""Messages inside of others, over processes and files, and of a package that nothing imports for its texts."""

from __future__ import annotations

import copy
import json
import pickle
import sys
from pathlib import Path
from typing import Any

import pytest

from daq.errors import AcquisitionError, InputError, first_line
from daq.messages import (
    Sentence,
    first_of,
    is_code,
    listed,
    message_from_json,
    message_of,
    named,
    one_line,
    put_together,
    texts,
    with_their_messages,
)

ENGLISH = {
    "late": "{name} is {by:.2g} s late at {rate:g} Hz",
    "of": "{name!s}: {what} ({parts:; })",
    "kept": "{name!s} is {state}",
    "plain": "nothing {{here}}",
}
GERMAN = {
    "late": "{name} ist {by:.2g} s zu spät bei {rate:g} Hz",
    "of": "{name!s}: {what} ({parts:; })",
    "kept": "{name!s}: {state}",
    "plain": "nichts {{hier}}",
}


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package of somebody's own, which nothing may import."""
    folder = tmp_path / "plugin"
    (folder / "texts").mkdir(parents=True)
    (folder / "__init__.py").write_text("raise RuntimeError")
    for language, messages, words in (
        ("en", ENGLISH, {}),
        ("de", GERMAN, {"running": "läuft", "oil level": "Ölstand"}),
    ):
        (folder / "texts" / f"{language}.json").write_text(json.dumps({"messages": messages, "words": words}))
    monkeypatch.syspath_prepend(str(tmp_path))
    texts.cache_clear()


def test_values_may_be_messages_and_lists_of_them() -> None:
    late = Sentence("plugin.late", name="a", by=1.25, rate=1e3)
    whole = Sentence("plugin.of", name="running", what=late, parts=[late, "running", 1.0, 2.5])
    assert whole == f"running: {late} ({late}; running; 1; 2.5)"
    assert whole.worded("de") == f"running: {late.worded('de')} ({late.worded('de')}; läuft; 1; 2,5)"


@pytest.mark.parametrize("again", [lambda s: pickle.loads(pickle.dumps(s)), copy.deepcopy, lambda s: message_from_json(
    json.loads(json.dumps(s.to_json(), allow_nan=False)))])  # fmt: skip
def test_it_travels(again: Any) -> None:
    inner = Sentence("plugin.late", name="a", by=float("nan"), rate=7)
    other = again(Sentence("plugin.of", name="x", what=inner, parts=[inner, 3]))
    assert other == "x: a is nan s late at 7 Hz (a is nan s late at 7 Hz; 3)"
    assert other.worded("de") == "x: a ist nan s zu spät bei 7 Hz (a ist nan s zu spät bei 7 Hz; 3)"
    assert type(other) is Sentence and type(other.values["what"]) is Sentence


def test_json_content_carries_its_messages_and_is_put_together_again() -> None:
    late = Sentence("plugin.late", name="a", by=1, rate=2)
    content = {"error": late, "more": [{"text": late}, "as it is", 3]}
    sent = json.loads(json.dumps(with_their_messages(content)))
    assert sent["messages"] == {str(late): late.to_json() | {"worded": {"de": late.worded("de")}}}
    got = put_together(sent)
    assert got == content and message_of(got["more"][0]["text"]) == late.to_json()
    assert with_their_messages({"a": "b"}) == {"a": "b"} == put_together({"a": "b"})


def test_a_message_that_is_the_text_of_its_only_value_is_put_together_once() -> None:
    one = Sentence("daq.listed", items=["a"])
    again = put_together({"text": "a", "messages": {"a": one.to_json()}})
    assert message_of(again["text"]) == one.to_json()


def test_of_another_version_a_sentence_stays_what_it_is() -> None:
    unknown = {"code": "plugin.gone", "values": {}}
    assert put_together({"error": "old", "messages": {"old": unknown}}) == {"error": "old"}
    with pytest.raises(KeyError):
        message_from_json(unknown)
    with pytest.raises(KeyError):
        Sentence("plugin.late", name="a")


def test_an_error_has_its_sentence_as_text_or_whatever_it_was_given() -> None:
    assert message_of(str(InputError("plugin.kept", name="a", state="running"))) is not None
    assert message_of(str(InputError("plugin.plain"))) == {"code": "plugin.plain", "values": {}}
    assert str(InputError("plugin.plain: no code")) == "plugin.plain: no code"
    assert not is_code("nowhere.plain") and not is_code("os.path") and not is_code("a sentence.")
    late = Sentence("plugin.plain")
    assert message_of(first_line(AcquisitionError(late))) == late.to_json()
    assert first_line(AcquisitionError("one\ntwo")) == "one"


def test_places_lists_and_replaced_names_stay_messages() -> None:
    late = Sentence("plugin.late", name="/tmp/x.csv", by=1, rate=2)
    assert named("arm.yaml:3", late) == f"arm.yaml:3: {late}"
    assert first_of([late]) is late and first_of([late, "b", "c"]) == f"{late} (and 2 more)"
    assert listed([late]) is late and listed([late, "b"]) == f"{late}; b"
    assert named("/tmp/x.csv", late).replace("/tmp/", "").worded("de") == "x.csv: x.csv ist 1 s zu spät bei 2 Hz"
    assert one_line(late) is late and one_line("a\n b") == "a b"
    assert "plugin" not in sys.modules
