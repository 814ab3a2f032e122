"""English sentences in Python sources, read without running them: ``{}`` stands for each value."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator
from itertools import product
from pathlib import Path

ROOT = Path(__file__).parents[3]
#: Two words at least, or a value beside one.
_WORDS = re.compile(r"[a-z]+ [a-z{]|[a-z}] [a-z]+")


def templates(node: ast.expr) -> list[str]:
    """What an expression may say: both ways of a condition, parts that are put together; values in a row are one."""
    return [re.sub(r"(\{\})+", "{}", text) for text in _forms(node)]


def _forms(node: ast.expr) -> list[str]:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return [re.sub(r"\{\w*\}", "{}", node.value)]  # a text for str.format
    if isinstance(node, ast.JoinedStr):
        parts = [
            _forms(part.value if isinstance(part, ast.FormattedValue) else part)
            if isinstance(part, ast.Constant) or isinstance(getattr(part, "value", None), ast.IfExp)
            else ["{}"]
            for part in node.values
        ]
        return ["".join(chosen) for chosen in product(*parts)]
    if isinstance(node, ast.IfExp):
        return _forms(node.body) + _forms(node.orelse)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return [first + second for first in _forms(node.left) for second in _forms(node.right)]
    return ["{}"]


def _is_text(node: ast.AST) -> bool:
    if isinstance(node, ast.BinOp):
        return isinstance(node.op, ast.Add) and (_is_text(node.left) or _is_text(node.right))
    return isinstance(node, ast.JoinedStr | ast.IfExp) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def every_text(tree: ast.AST) -> Iterator[str]:
    """Every text of two words or more that is no docstring."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue
        said = templates(node) if isinstance(node, ast.expr) and _is_text(node) else []
        yield from (text for text in said if _WORDS.search(text))
        if all(text == "{}" for text in said):
            yield from every_text(node)


def told(tree: ast.AST, errors: Collection[str]) -> Iterator[str]:
    """First arguments of ``errors``, texts of problem documents, and what is assigned to ``detail``.

    What a repository says of each kind of thing that it does not have is said where that is declared, by its ``noun``.
    """
    for node in ast.walk(tree):
        found: list[ast.expr] = []
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            found = node.args[:1] if name in errors else node.args[2:3] if name == "problem" else []
        elif isinstance(node, ast.ClassDef):
            nouns = (keyword.value for keyword in node.keywords if keyword.arg == "noun")
            yield from (f"there is no {noun.value} '{{}}'" for noun in nouns if isinstance(noun, ast.Constant))
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("detail", "text", "refusal"):
            by_key = [one for one in ast.walk(node.value) if isinstance(one, ast.Dict)]
            found = [value for one in by_key for value in one.values] or [node.value]
        yield from (text for one in found for text in templates(one) if text.strip("{}"))


def trees(*places: str) -> Iterable[ast.AST]:
    """Sources of files and folders, from the project's root."""
    for place in places:
        files = sorted((ROOT / place).rglob("*.py")) if (ROOT / place).is_dir() else [ROOT / place]
        for file in files:
            yield ast.parse(file.read_text("utf-8"))
