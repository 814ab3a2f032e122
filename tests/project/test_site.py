"""The documentation site, without building it: every page is in a table of contents, every example is one.

The site itself is built by ``make docs``, where warnings are errors.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
#: Made when the site is built.
GENERATED = {"reference/cli", "reference/rest", "reference/effects", "reference/machine-file-keys", "reference/report"}
TREE = re.compile(r"^```\{toctree\}\n(.*?)^```", re.MULTILINE | re.DOTALL)
EXAMPLES = sorted((DOCS / "examples").glob("plot_*.py"))


def pages() -> set[str]:
    """Every page that is written by hand or by a command and committed."""
    return {
        path.relative_to(DOCS).with_suffix("").as_posix()
        for path in DOCS.rglob("*.md")
        if not {"_build", "gallery"} & set(path.relative_to(DOCS).parts)
    } - GENERATED


def listed(page: str) -> set[str]:
    """Pages in the tables of contents of a page."""
    found: set[str] = set()
    for block in TREE.findall((DOCS / f"{page}.md").read_text(encoding="utf-8")):
        for line in block.splitlines():
            entry = line.strip()
            if not entry or entry.startswith(":"):
                continue
            titled = re.fullmatch(r".+ <(.+)>", entry)
            entry = titled[1] if titled else entry
            place = (DOCS / page).parent / entry
            for path in sorted(place.parent.glob(place.name + ".md")) or [place.with_suffix(".md")]:
                found.add(path.resolve().relative_to(DOCS).with_suffix("").as_posix())
    return found


def test_every_page_is_reached_from_the_first_one() -> None:
    reached, new = set(), {"index"}
    while new:
        reached |= new
        new = {page for own in new if (DOCS / f"{own}.md").is_file() for page in listed(own)} - reached
    assert pages() - reached == set(), "in no table of contents"
    assert reached - pages() - GENERATED == {"gallery/index"}, "in a table of contents, and not there"


def test_generated_pages_are_ignored_by_git() -> None:
    ignored = (DOCS.parent / ".gitignore").read_text(encoding="utf-8").splitlines()
    assert {f"docs/{page}.md" for page in GENERATED} <= set(ignored)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_can_be_read_as_a_page(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    title, line, *text = (ast.get_docstring(tree) or "").splitlines()
    assert title and set(line) == {"="} and len(line) == len(title)
    assert any(text), "says what it shows"
    imported = {
        node.module.partition(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module
    }
    assert "server" not in imported, "examples run without a server"


def test_pictures_of_the_first_screen_are_small() -> None:
    assert (DOCS / "_static" / "before-after.png").stat().st_size < 150_000
