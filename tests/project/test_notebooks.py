"""Notebooks of the documentation run from top to bottom, and show what a person looks at."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow
FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"


def run(notebook: Path) -> tuple[dict[str, Any], list[Any]]:
    """The names that a notebook leaves behind, and the value of each cell that ends with an expression."""
    names: dict[str, Any] = {"__name__": "__main__"}
    values = []
    for cell in json.loads(notebook.read_text("utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        tree = ast.parse("".join(cell["source"]))
        last = tree.body[-1]
        if isinstance(last, ast.Expr):
            tree.body.pop()
        exec(compile(tree, notebook.name, "exec"), names)
        if isinstance(last, ast.Expr):
            values.append(eval(compile(ast.Expression(last.value), notebook.name, "eval"), names))
    return names, values


def test_arrays_become_a_model(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr("tempfile.mkdtemp", lambda *_, **__: str(tmp_path))
    names, values = run(FOLDER / "from-arrays.ipynb")
    machine, recording, result, model, _ = values
    assert repr(machine) == "Machine(bench: slide)"
    assert repr(recording) == "Recording(arrays: 3 channels, 2000 rows, 39.98 s)"
    assert repr(result).startswith(f"Result({result.report['loop']['verdict']}") and len(repr(result)) < 200
    assert "<td>slide</td>" in result._repr_html_() and "slide.f_c" in model._repr_html_()
    assert [len(axis.lines) for axis in names["figure"].axes] == [2, 2]
    assert names["largest"] < 10.0  # N, of 95 N of Coulomb friction and more
    assert result.report["loop"]["verdict"] == "nothing_missing"


def test_a_notebook_imports_hilfit_alone_and_holds_no_results() -> None:
    for notebook in FOLDER.glob("*.ipynb"):
        cells = json.loads(notebook.read_text("utf-8"))["cells"]
        text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        assert not any(f"{name}" in text for name in ("import daq", "from daq", "from fitting", "sim_backends"))
        assert all(cell.get("outputs", []) == [] for cell in cells)
