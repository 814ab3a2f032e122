"""What the report says in fixed texts has a German text on the page: a new effect cannot be forgotten."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from fitting.effects import effects
from fitting.report.joint_words import _AS_WRITTEN, _SIGNALS, _TEXTS, JointWords

WEB = Path(__file__).parents[3] / "server" / "web" / "src" / "texts"
#: English texts of the table: the string before a colon.
KNOWN = {
    json.loads(found)
    for found in re.findall(r'^  ("(?:[^"\\]|\\.)*"):', (WEB / "report_de.ts").read_text("utf-8"), re.M)
}
WORDS = {"cylinder": _AS_WRITTEN, "direct": JointWords(_SIGNALS, _TEXTS, {})}


@pytest.mark.parametrize("drive", WORDS)
def test_titles_places_and_experiments_of_all_effects_have_a_german_text(drive: str) -> None:
    said = [text for one in effects() for text in (one.title, one.look_at, one.experiment) if text]
    assert len(said) > 80
    assert sorted({text for text in map(WORDS[drive].text, said) if text not in KNOWN}) == []
