"""No folder of a package is a heap; those of a seam have one file for each of what is added there."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("benchmarks", "daq", "fitting", "hilfit", "server", "sim_backends")
#: What one looks over at a glance.
MOST_MODULES = 15
#: One file for each effect.
SEAMS = {"fitting/effects"}
#: Lines of a function that one sees at once, its docstring not counted.
MOST_LINES = 60


def test_no_folder_has_more_modules_than_one_looks_over() -> None:
    modules = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py") if path.stem != "__init__"]
    folders = Counter(path.parent.relative_to(ROOT).as_posix() for path in modules if "node_modules" not in path.parts)
    assert len(folders) > 50
    assert {folder for folder, count in folders.items() if count > MOST_MODULES} == SEAMS


def test_every_room_says_what_it_holds() -> None:
    rooms = {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    silent = [room for room in sorted(rooms) if "node_modules" not in room.parts and not _says(room / "__init__.py")]
    assert [room.relative_to(ROOT).as_posix() for room in silent] == []


@pytest.mark.slow
def test_no_function_is_longer_than_one_sees_at_once() -> None:
    modules = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    functions = [
        (f"{path.relative_to(ROOT).as_posix()}:{own.name}", _lines(own))
        for path in modules
        if "node_modules" not in path.parts
        for own in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(own, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    assert len(functions) > 5000
    assert [(name, lines) for name, lines in functions if lines > MOST_LINES] == []


def _lines(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    said = ast.get_docstring(function, clean=False)
    return (function.end_lineno or 0) - function.lineno + 1 - (0 if said is None else said.count("\n") + 1)


def _says(path: Path) -> bool:
    return path.exists() and path.read_text(encoding="utf-8").lstrip().startswith(('"""', 'r"""'))
