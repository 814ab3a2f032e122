"""``locks/``: all that is asked for, in versions that are allowed, with hashes, and no place of whoever made them."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
MAKEFILE = (ROOT / "Makefile").read_text()
#: What make installs from each of them.
FILES = {name: extras.split() for name, extras in re.findall(r"^EXTRAS_(\w+) := (.+)$", MAKEFILE, flags=re.M)}
#: A name and a version, where it is for some computers only which, and on lines of their own the hashes.
ENTRY = r"[a-z0-9-]+==[a-z0-9.]+( ; [a-z0-9_ .<>=!'*A-Z()]+)?"
HASH = r"    --hash=sha256:[0-9a-f]{64}"


def asked_for(extras: list[str]) -> list[Requirement]:
    """Requirements of the project with these extras, and of the extras that they name."""
    found = [Requirement(line) for line in PROJECT["dependencies"]]
    for extra in extras:
        for line in EXTRAS[extra]:
            named = Requirement(line)
            found += asked_for(sorted(named.extras)) if named.name == "hilfit" else [named]
    return found


@cache
def entries(name: str) -> list[list[str]]:
    """Of each entry of a lock file its lines: the requirement, then its hashes."""
    text = (ROOT / "locks" / f"{name}.txt").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    starts = [i for i, line in enumerate(lines) if not line.startswith(" ")]
    return [
        [line.removesuffix(" \\") for line in lines[a:b]]
        for a, b in zip(starts, [*starts[1:], len(lines)], strict=True)
    ]


@cache
def locked(name: str) -> list[Requirement]:
    return [Requirement(first) for first, *_ in entries(name)]


ASKED = [pytest.param(name, asked, id=f"{name}-{asked.name}") for name in FILES for asked in asked_for(FILES[name])]


def test_every_lock_file_is_of_extras_that_exist() -> None:
    assert {path.stem for path in (ROOT / "locks").iterdir()} == set(FILES)
    assert {extra for extras in FILES.values() for extra in extras} <= set(EXTRAS)


@pytest.mark.parametrize(("name", "asked"), ASKED)
def test_what_is_asked_for_is_locked_in_an_allowed_version(name: str, asked: Requirement) -> None:
    found = [own for own in locked(name) if canonicalize_name(own.name) == canonicalize_name(asked.name)]
    assert found, f"{asked.name} is not in locks/{name}.txt; run: make lock"
    for own in found:
        (version,) = [specifier.version for specifier in own.specifier]
        assert asked.specifier.contains(version), f"{own} does not fit {asked}; run: make lock"


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_one_version_of_each_is_for_every_computer(name: str, python: str, machine: str) -> None:
    place = {"python_full_version": f"{python}.4", "python_version": python, "platform_machine": machine}
    names = [canonicalize_name(r.name) for r in locked(name) if r.marker is None or r.marker.evaluate(place)]
    assert len(set(names)) == len(names)
    asked = asked_for(FILES[name])
    assert {canonicalize_name(r.name) for r in asked if r.marker is None or r.marker.evaluate(place)} <= set(names)


@pytest.mark.parametrize("name", FILES)
def test_an_entry_is_a_name_a_version_and_hashes(name: str) -> None:
    wrong = [own for own in entries(name) if not re.fullmatch(rf"{ENTRY}(\n{HASH})+", "\n".join(own))]
    assert wrong == []


def test_all_lock_files_have_the_same_versions() -> None:
    versions: dict[tuple[str, str], set[str]] = {}
    for name in FILES:
        for own in locked(name):
            versions.setdefault((own.name, str(own.marker)), set()).add(str(own.specifier))
    assert {key: found for key, found in versions.items() if len(found) > 1} == {}


def test_the_project_itself_is_built_with_what_is_locked() -> None:
    """No download without a hash: pip fetches nothing to build with."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]["requires"]
    assert [Requirement(line).name for line in wanted] == ["setuptools"]
    for name in FILES:
        assert "setuptools" in {own.name for own in locked(name)}
    assert "--no-build-isolation" in MAKEFILE and "--require-hashes" in MAKEFILE


def test_nothing_is_installed_past_the_locks() -> None:
    """Every call of pip is that of ``install``, or has the hashes of a lock file itself."""
    unlocked = [
        line.strip()
        for line in MAKEFILE.replace("\\\n", " ").splitlines()
        if "$(PIP)" in line and not line.startswith("install = ")
    ]
    assert unlocked == []
    dockerfile = (ROOT / "Dockerfile").read_text()
    installs = [line for line in dockerfile.splitlines() if "pip install" in line]
    assert len(installs) == 2
    assert "--require-hashes -r locks/image.txt" in installs[0]
    assert "--no-deps --no-build-isolation ." in installs[1]
    targets = re.findall(r"call install,(\w+)", MAKEFILE)
    assert sorted(targets) == sorted(set(FILES) - {"image"})
