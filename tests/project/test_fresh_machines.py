"""``make test-fresh``: what a new machine is told, and where none can be made. Making one takes root and minutes."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import fresh_machines
import pytest

ROOT = Path(__file__).parents[2]


def test_without_root_it_says_so_in_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    monkeypatch.setattr(sys, "argv", ["fresh_machines.py"])
    assert fresh_machines.main() == 2
    said = capsys.readouterr()
    assert (said.out, said.err) == (
        "", "make test-fresh: needs root, to make machines and to enter them; run: sudo make test-fresh\n",
    )  # fmt: skip


def test_a_program_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.geteuid", lambda: 0)
    monkeypatch.setattr("shutil.which", lambda name: None)
    assert fresh_machines.unavailable() == "there is no mmdebstrap; install it with: apt-get install mmdebstrap"


def test_what_pip_and_apt_are_told_goes_along(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    wheels, certificate = tmp_path / "my wheels", tmp_path / "ca.crt"
    wheels.mkdir()
    certificate.touch()
    said = {
        "pip": f":env:.cert='{certificate}'\nglobal.cert='/of/another'\nglobal.extra-index-url='\\nfile://"
        f"{str(wheels).replace(' ', '%20')}\\nfile:///nowhere'\n",
        "dump": 'Acquire::http::Proxy "http://proxy:3142";\nAcquire::Retries "3";\nAcquire::https "";\n',
        "indextargets": "http://updates/ other-updates\n",
    }
    monkeypatch.setattr(
        fresh_machines, "_said", lambda *command: next(text for word, text in said.items() if word in command)
    )
    monkeypatch.setattr("os.environ", {"https_proxy": "http://proxy:3142", "HILFIT_HOST": "x", "PIP_CERT": "y"})
    told = fresh_machines.told()
    assert told.environment == {
        "https_proxy": "http://proxy:3142",
        "PIP_CERT": str(certificate),  # what the environment says outranks files
        "PIP_EXTRA_INDEX_URL": f"file://{str(wheels).replace(' ', '%20')} file:///nowhere",
    }
    assert tmp_path in told.places and told.environment["PIP_CERT"].startswith(str(tmp_path))
    assert all(place.exists() for place in told.places)
    assert told.apt == ('Acquire::http::Proxy "http://proxy:3142";',)
    assert told.mirror is None, "not one of updates alone"


def test_a_machine_has_this_checkout_without_what_git_ignores(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    entered: list[str] = []
    monkeypatch.setattr(fresh_machines, "enter", lambda machine, who, told, script, bound: entered.append(script))
    monkeypatch.setattr(fresh_machines, "ROOT", tmp_path / "checkout")
    for name in (".gitignore", "a/b.py", ".venv/bin/python"):
        (tmp_path / "checkout" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "checkout" / name).write_text(".venv/\n")
    subprocess.run(["git", "init", "--quiet", tmp_path / "checkout"], check=True)
    fresh_machines.put_checkout(tmp_path / "machine", "user", fresh_machines.Told({}, (), (), None))
    home = tmp_path / "machine" / "home" / "user" / "hilfit"
    assert {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()} == {".gitignore", "a/b.py"}
    assert entered == ["chown -R user: ~user/hilfit"]


def test_the_hosted_checks_are_those_of_this_project_on_every_python_that_it_names() -> None:
    workflow = (ROOT / ".github" / "workflows" / "checks.yml").read_text()
    named = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["classifiers"]
    versions = [line.rpartition(" ")[2] for line in named if re.search(r":: 3\.\d+$", line)]
    assert versions == ["3.11", "3.12", "3.13"]
    assert f"python: {versions}".replace("'", '"') in workflow
    assert "- run: .ci/run" in workflow
