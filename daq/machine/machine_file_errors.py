"""Problems of a machine file, one line each: file, line, key, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

from daq.messages import Sentence, named, one_line
from daq.validation_words import in_words

#: Keys, and numbers in lists, that lead to a part of a file.
Place: TypeAlias = tuple[str | int, ...]
#: What machines, joints, channels and buses may be called.
NAME_PATTERN = r"^[A-Za-z_][A-Za-z0-9_.\-]*$"
#: Characters of what was found that are shown.
_SHOWN = 60


def did_you_mean(word: str, options: Sequence[str]) -> str:
    """Return ``; did you mean '...'?`` or nothing."""
    near = difflib.get_close_matches(word, options, n=1)
    return Sentence("daq.did_you_mean", near=near[0]) if near else ""


@dataclass(frozen=True)
class Problem:
    """One thing to look at: where in the file, and what to do about it.

    Attributes
    ----------
    line : line of the file, from 1; None where it is not known
    key : the key's place, as in ``joints[0].cylinder.bore``; empty for the file as a whole
    text : what is wrong
    cure : what to do; empty where the text says it
    level : ``error``: the file cannot be used; ``warning``: it can, but a number is hardly meant
    """

    line: int | None
    key: str
    text: str
    cure: str = ""
    level: Literal["error", "warning"] = "error"

    def under(self, name: str) -> str:
        """Return one line with the file's name in front."""
        line: str = one_line(self.text)
        line = Sentence("daq.with_cure", what=line, cure=self.cure) if self.cure else line
        line = named(self.key, line) if self.key else line
        line = Sentence("daq.warning", what=line) if self.level == "warning" else line
        return named(f"{name}:{self.line}" if self.line else name, line)


def all_problems(
    tree: yaml.Node | None, error: ValidationError, keys: Sequence[str], tags: Collection[str]
) -> list[Problem]:
    """Return all that pydantic found, unknown keys first: they explain more than the missing ones they replace.

    Parameters
    ----------
    tree : the file's YAML nodes, which know their lines
    keys : all keys that the file may have, to guess what an unknown one was meant to be
    tags : names of alternatives, which pydantic puts into places and the file does not have
    """
    found = error.errors(include_url=False)
    if len(found) > 1:  # a list of which every item is wrong is not too short
        found = [p for p in found if not (p["type"] == "too_short" and p["input"])]
    found.sort(key=lambda p: p["type"] != "extra_forbidden")
    result = []
    for problem in found:
        cause = (problem.get("ctx") or {}).get("error")
        located = getattr(cause, "located", None) or [(getattr(cause, "at", ()), in_words(problem))]
        result += [_problem(tree, problem, at, text, keys, tags) for at, text in located]
    return result


def _problem(
    tree: yaml.Node | None, problem: ErrorDetails, at: Place, what: str, keys: Sequence[str], tags: Collection[str]
) -> Problem:
    location = [part for part in problem["loc"] if not (isinstance(part, str) and part in tags)]
    key = key_of(location)
    if problem["type"] == "extra_forbidden":
        hint = did_you_mean(str(location[-1]), keys)
        what = Sentence("daq.unknown_key", hint=hint) if hint else Sentence("daq.unknown_key_remove")
    elif problem["type"] == "missing":
        what = Sentence("daq.key_missing")
    elif isinstance(problem.get("input"), str | int | float | bool):
        if problem["type"] == "string_pattern_mismatch" and problem["ctx"]["pattern"] == NAME_PATTERN:
            what = Sentence("daq.write_letters_digits_beginning")
        what = what if isinstance(what, Sentence) else what[0].lower() + what[1:]
        what = Sentence("daq.with_what_was_found", what=what, problem=short(repr(problem["input"])))
    return Problem(line_of(tree, [*location, *at]), key, what)


def key_of(place: Sequence[str | int]) -> str:
    """Write a place as a key, ``joints[0].cylinder.bore``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def short(text: str) -> str:
    """Cut a text in its middle to fit into a line."""
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN // 2]}\u2026{text[-_SHOWN // 4 :]}"


def line_of(tree: yaml.Node | None, location: Sequence[str | int]) -> int | None:
    """Return the line (from 1) of the deepest part of ``location`` in the file."""
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
