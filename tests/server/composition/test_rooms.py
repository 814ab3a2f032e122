"""The rooms of the server: a module is found by its name, and no folder is a heap."""

from __future__ import annotations

import re
from collections import Counter
from importlib import import_module
from pathlib import Path

from server.composition.declarations import ORDER, RESOURCES
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.resource import TROUBLES, providers_of
from server.platform.service import Service
from server.platform.settings import Settings

SERVER = Path(__file__).parents[3] / "server"
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
    assert sorted(declared) == sorted(resource.name for resource in RESOURCES)
    assert set(ORDER) <= declared


def test_every_part_that_is_asked_for_is_provided() -> None:
    """The type checker knows what a part is, not whether a declaration makes it."""
    known = {*providers_of(RESOURCES), Service, Settings, Changes, DataDirectory, Database, TROUBLES}
    asked = {}
    for path in MODULES:
        names = set(re.findall(r"\b(?:service|parts)\[([A-Z]\w*)\]", path.read_text()))
        if names:
            module = import_module(".".join(path.relative_to(SERVER.parent).with_suffix("").parts))
            asked |= {f"{module.__name__}: {name}": getattr(module, name) for name in names if hasattr(module, name)}
    assert len(asked) > 100, "the pattern finds them no more"
    assert [place for place, key in asked.items() if key not in known] == []
