"""What GitHub, editors and pre-commit read says the same as pyproject.toml and the Makefile."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
MAKE = (ROOT / "Makefile").read_text("utf-8")


def content_of(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text("utf-8"))


def test_the_citation_is_of_this_version_and_licence() -> None:
    citation = content_of("CITATION.cff")
    assert (citation["version"], citation["license"]) == (PROJECT["version"], PROJECT["license"])
    assert citation["title"].lower().endswith(PROJECT["description"].lower())
    assert {"cff-version", "message", "authors"} <= citation.keys()


def test_what_runs_before_a_commit_is_of_make_check() -> None:
    checks = re.search(r"^check: .*\n((?:\t.*\n)+)", MAKE, re.M)
    assert checks is not None
    commands = [line.replace("$(BIN)", ".venv/bin").removesuffix(" .") for line in checks[1].split("\n\t")]
    hooks = [hook for repository in content_of(".pre-commit-config.yaml")["repos"] for hook in repository["hooks"]]
    assert len(hooks) == 3
    for hook in hooks:
        assert hook["entry"] in {command.strip() for command in commands}
        assert hook["language"] == "system", "the versions that are locked, and no others"


def test_the_container_of_editors_has_the_oldest_python_and_what_the_page_needs() -> None:
    container = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text("utf-8"))
    assert f"python:{PROJECT['requires-python'].removeprefix('>=')}-" in container["image"]
    assert container["postCreateCommand"].removeprefix("make ") in MAKE.replace("$(VENV)", ".venv")
    (node,) = (options["version"] for name, options in container["features"].items() if "/node:" in name)
    assert f"needs Node {node}" in MAKE


def test_every_python_that_is_named_is_checked() -> None:
    named = [one.rpartition(" ")[2] for one in PROJECT["classifiers"] if "Python :: 3." in one]
    (job,) = content_of(".github/workflows/checks.yml")["jobs"].values()
    assert job["strategy"]["matrix"]["python"] == named


@pytest.mark.parametrize("name", ["fault", "wish"])
def test_a_form_asks_for_something_that_has_to_be_answered(name: str) -> None:
    form = content_of(f".github/ISSUE_TEMPLATE/{name}.yml")
    assert form["name"] and form["description"]
    ids = [field["id"] for field in form["body"]]
    assert len(set(ids)) == len(ids) >= 3
    assert all(field["attributes"]["label"] for field in form["body"])
    assert any(field.get("validations", {}).get("required") for field in form["body"])
