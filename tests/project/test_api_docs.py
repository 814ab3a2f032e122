"""What the documentation shows of the Python interface says what every argument is."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SHOWN = re.findall(r"auto(?:function|class):: (\S+)", (ROOT / "docs" / "reference" / "api.md").read_text())
SECTION = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+\n|\Z)", re.MULTILINE | re.DOTALL)


def shown() -> Iterator[tuple[str, Callable[..., Any], str]]:
    """Every function and method that is shown, with the text of its class: it may say what its methods share."""
    for name in SHOWN:
        module, last = name.rpartition(".")[::2]
        found = getattr(import_module(module or "hilfit"), last)
        if not inspect.isclass(found):
            yield name, found, ""
            continue
        for own, member in vars(found).items():
            function = getattr(member, "__func__", member)
            if inspect.isfunction(function) and not own.startswith("_"):
                yield f"{name}.{own}", function, inspect.getdoc(found) or ""


def described(text: str) -> set[str]:
    section = SECTION.search(text)
    lines = re.findall(r"^(\w[\w, ]*) : ", section[1], re.MULTILINE) if section else []
    return {name for line in lines for name in line.split(", ")}


@pytest.mark.parametrize(("name", "function", "beside"), list(shown()), ids=[name for name, _, _ in shown()])
def test_every_argument_is_described(name: str, function: Callable[..., Any], beside: str) -> None:
    arguments = list(inspect.signature(function).parameters)
    if hasattr(function, "__wrapped__"):  # a function of a model's content as a method: the model is the object
        arguments = arguments[1:]
    known = described(inspect.getdoc(function) or "") | described(beside) | {"self", "cls"}
    assert set(arguments) <= known, f"{name}: {sorted(set(arguments) - known)}"
