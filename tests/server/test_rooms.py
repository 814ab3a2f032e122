"""The rooms of the server: a module is found by its name, and no folder is a heap."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from server.composition.declarations import RESOURCES

SERVER = Path(__file__).parents[2] / "server"
MODULES = [path for path in SERVER.rglob("*.py") if path.relative_to(SERVER).parts[0] not in ("bench", "web")]
#: What one looks over at a glance.
MOST_MODULES = 15


def test_no_two_modules_have_the_same_name() -> None:
    names = Counter(path.stem for path in MODULES if path.stem not in ("__init__", "__main__"))
    assert [name for name, count in names.items() if count > 1] == []


def test_no_folder_has_more_modules_than_one_looks_over() -> None:
    folders = Counter(path.parent for path in MODULES)
    assert {str(folder): count for folder, count in folders.items() if count > MOST_MODULES} == {}


def test_a_resource_has_the_name_of_its_folder_and_is_declared_there() -> None:
    declared = {path.parent.name for path in SERVER.glob("*/*_resource.py")}
    assert declared == {resource.name for resource in RESOURCES}
