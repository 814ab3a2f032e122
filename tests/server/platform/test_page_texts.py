"""What reports, alarms and jobs say in fixed texts has a German text on the page: a new one cannot be forgotten."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from fitting.effects import effects
from fitting.pipeline.stage_names import WORDS as STAGES
from fitting.report.joint_words import _AS_WRITTEN, _SIGNALS, _TEXTS, JointWords
from server.recalibrations.recalibration_job import WORDS as RECALIBRATION

ROOT = Path(__file__).parents[3]
WEB = ROOT / "server" / "web" / "src" / "texts"
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


#: Where alarms and what a job does are worded; the demonstration is no job.
WORDED = (
    "server/alarms/alarm_watch.py",
    "server/monitor/monitor_supervisor.py",
    "server/monitor/overload_text.py",
    "server/jobs/job_runner.py",
    "server/jobs/job_store.py",
    "server/recalibrations/recalibration_recording.py",
    "fitting/pipeline/stages.py",
    "fitting/pipeline/attribution_stage.py",
    "fitting/pipeline/stage_two.py",
    "fitting/loop",
    "fitting/selection",
    "fitting/checks/check.py",
)


def _sentence(node: ast.expr) -> str | None:
    """A literal as it is read, with ``1`` for each value; None for what is no literal."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "1" for v in node.values)
    return None


def _sentences(tree: ast.AST) -> Iterator[str]:
    """Second arguments of ``progress`` and ``said``, what is assigned to ``text``, and what ``as_text`` returns."""
    for node in ast.walk(tree):
        found: list[ast.expr] = []
        if isinstance(node, ast.Call) and len(node.args) == 2:
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            found = [node.args[1]] if name in ("progress", "said") else []
        elif isinstance(node, ast.Assign):
            several = isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
            pairs = (
                zip(node.targets[0].elts, node.value.elts, strict=True) if several else [(node.targets[0], node.value)]
            )
            found = [value for target, value in pairs if getattr(target, "id", "") == "text"]
        elif isinstance(node, ast.FunctionDef) and node.name == "as_text":
            found = [part.value for part in ast.walk(node) if isinstance(part, ast.Return) and part.value is not None]
        yield from (said for one in found if (said := _sentence(one)))


def _known() -> tuple[set[str], list[re.Pattern[str]]]:
    table = (WEB / "service_de.ts").read_text("utf-8")
    fixed = re.findall(r'^  (?:"((?:[^"\\]|\\.)*)"|(\w+)):', table, re.M)
    patterns = re.findall(r"/(\^.+\$)/", table)
    return {quoted or bare for quoted, bare in fixed}, [re.compile(pattern) for pattern in patterns]


@pytest.mark.parametrize("place", WORDED)
def test_alarms_and_what_a_job_does_have_a_german_text(place: str) -> None:
    files = sorted((ROOT / place).glob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
    said = {text for file in files for text in _sentences(ast.parse(file.read_text("utf-8")))}
    fixed, patterns = _known()
    assert said
    assert sorted(t for t in said if t not in fixed and not any(p.match(t) for p in patterns)) == []


def test_names_of_a_jobs_stages_have_a_german_text() -> None:
    fixed, _ = _known()
    assert {text for words in (STAGES, RECALIBRATION) for text in words.values()} <= fixed
    assert {text[:1].upper() + text[1:] for text in STAGES.values()} <= fixed
