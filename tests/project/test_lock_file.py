"""``requirements.lock``: all that is asked for, in versions that are allowed, and no place of whoever made it."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ASKED = [
    Requirement(line)
    for lines in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    for line in lines
    if not line.startswith("hilfit[")
]
LINES = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
LOCKED = [Requirement(line) for line in LINES]


@pytest.mark.parametrize("asked", ASKED, ids=lambda asked: asked.name)
def test_what_is_asked_for_is_locked_in_an_allowed_version(asked: Requirement) -> None:
    found = [locked for locked in LOCKED if canonicalize_name(locked.name) == canonicalize_name(asked.name)]
    assert found, f"{asked.name} is not in requirements.lock; run: make lock"
    for locked in found:
        (version,) = [specifier.version for specifier in locked.specifier]
        assert asked.specifier.contains(version), f"{locked} does not fit {asked}; run: make lock"


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_one_version_of_each_is_for_every_computer(python: str, machine: str) -> None:
    place = {"python_full_version": f"{python}.4", "python_version": python, "platform_machine": machine}
    names = [canonicalize_name(r.name) for r in LOCKED if r.marker is None or r.marker.evaluate(place)]
    assert len(set(names)) == len(names)
    assert {canonicalize_name(r.name) for r in ASKED if r.marker is None or r.marker.evaluate(place)} <= set(names)


def test_every_line_is_a_name_and_a_version() -> None:
    assert [
        line for line in LINES if not re.fullmatch(r"[a-z0-9-]+==[a-z0-9.]+( ; [a-z0-9_ .<>=!'*A-Z]+)?", line)
    ] == []
