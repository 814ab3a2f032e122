"""Documents: links lead somewhere, decisions are short, each with a number of its own."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DECISIONS = sorted((ROOT / "docs" / "decisions").glob("0*.md"))
DOCUMENTS = sorted(
    path
    for folder in (
        ".",
        "benchmarks",
        "benchmarks/results",
        "docs",
        "docs/decisions",
        "docs/explanation",
        "docs/how-to",
        "news",
    )
    for path in (ROOT / folder).glob("*.md")
)
LINK = re.compile(r"\]\(([^)\s]+)\)")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files(path: Path) -> None:
    links = LINK.findall(re.sub(r"```.*?```|`[^`]*`", "", path.read_text(), flags=re.DOTALL))
    here = [link.partition("#")[0] for link in links if not re.match(r"[a-z]+:", link)]
    base = ROOT if path.parent.name == "news" and path.name != "README.md" else path.parent  # they end in CHANGELOG.md
    assert [link for link in here if link and not (base / link).exists()] == []


def test_the_tests_that_security_names_are_there() -> None:
    rows = [row for row in (ROOT / "SECURITY.md").read_text("utf-8").splitlines() if "::test_" in row]
    assert len(rows) >= 12
    for row in rows:
        file = ""
        for named in re.findall(r"`([\w/.]*)::(test_\w+)`", row):
            file = named[0] or file
            assert f"def {named[1]}(" in (ROOT / "tests" / file).read_text("utf-8"), named


def test_decisions_are_numbered_and_listed() -> None:
    numbers = [int(path.name[:4]) for path in DECISIONS]
    assert len(set(numbers)) == len(numbers)
    listed = (ROOT / "docs" / "decisions" / "README.md").read_text()
    for path in DECISIONS:
        title = re.fullmatch(r"# (\d+)\. (.+)", path.read_text().splitlines()[0])
        assert title is not None and int(title[1]) == int(path.name[:4])
        assert f"| [{title[1]}]({path.name}) | {title[2]} |" in listed


@pytest.mark.parametrize("path", DECISIONS, ids=lambda path: path.name)
def test_a_decision_is_short(path: Path) -> None:
    assert len(path.read_text().split()) < 270, "what was measured belongs in benchmarks/results"
