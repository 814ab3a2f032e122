"""One line about what is wrong with a machine file: file, line, key, and what to do."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

import yaml
from pydantic import ValidationError

_UNION_TAGS = frozenset(("three_pin", "rack", "direct", "polynomial", "canopen", "modbus_tcp", "modbus_rtu", "other"))

#: What machines, joints, channels and buses may be called.
NAME_PATTERN = r"^[A-Za-z_][A-Za-z0-9_.\-]*$"
#: Characters of what was found that are shown.
_SHOWN = 60


def did_you_mean(word: str, options: Sequence[str]) -> str:
    """``; did you mean '...'?`` or nothing."""
    near = difflib.get_close_matches(word, options, n=1)
    return f"; did you mean '{near[0]}'?" if near else ""


def one_line(name: str, tree: yaml.Node | None, error: ValidationError, keys: Sequence[str]) -> str:
    """The most telling of the problems that pydantic found.

    Parameters
    ----------
    name : what to call the file
    tree : its YAML nodes, which know their lines
    keys : all keys that a machine file may have, to guess what an unknown one was meant to be
    """
    problems = error.errors(include_url=False)
    # An unknown key explains more than the missing one it stands for.
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    location = [part for part in problem["loc"] if not (isinstance(part, str) and part in _UNION_TAGS)]
    what = problem["msg"].removeprefix("Value error, ")
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".")
    line = _line_of(tree, location or _place(what, tree))
    if problem["type"] == "extra_forbidden":
        hint = did_you_mean(str(location[-1]), keys)
        what = f"unknown key{hint}" if hint else "unknown key; remove it"
    elif problem["type"] == "missing":
        what = "this key is missing"
    elif isinstance(problem.get("input"), str | int | float | bool):
        if problem["type"] == "string_pattern_mismatch" and problem["ctx"]["pattern"] == NAME_PATTERN:
            what = "write letters, digits, '_', '-' and '.', beginning with a letter or '_'"
        what = f"{what[0].lower()}{what[1:]} (found {_short(repr(problem['input']))})"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    place = f"{name}:{line}" if line else name
    return " ".join(f"{place}: {key}: {what}{more}".replace(": : ", ": ").split())


def _short(text: str) -> str:
    """A text that fits into a line, cut in its middle."""
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN // 2]}\u2026{text[-_SHOWN // 4 :]}"


def _place(text: str, tree: yaml.Node | None) -> list[str | int]:
    """Where a problem of the file as a whole is, which names its place in its text: ``channels[3]``, ``joints.arm``."""
    indexed = re.match(r"(channels|joints)\[(\d+)\]", text)
    if indexed is not None:
        return [indexed[1], int(indexed[2])]
    named = re.match(r"joints\.([^:]+):", text)
    if named is not None and isinstance(tree, yaml.MappingNode):
        for key, value in tree.value:
            if key.value == "joints" and isinstance(value, yaml.SequenceNode):
                for index, joint in enumerate(value.value):
                    pairs = joint.value if isinstance(joint, yaml.MappingNode) else ()
                    if any(k.value == "name" and v.value == named[1] for k, v in pairs):
                        return ["joints", index]
    return []


def _line_of(tree: yaml.Node | None, location: list[str | int]) -> int | None:
    """Line (from 1) of the deepest part of ``location`` that is in the file."""
    node, line = tree, None
    for part in location:
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                if key.value == str(part):
                    node, line = value, key.start_mark.line + 1
                    break
            else:
                return line
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
        else:
            return line
    return line
