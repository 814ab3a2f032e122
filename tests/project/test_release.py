"""``make release``: signed checksums that verify, a bill of materials with licences; without a key it says what to do.

The signature is checked as its receiver does, by the program of OpenSSH with the public key.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import shutil
import subprocess
import sys
import venv
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
needs_ssh = pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="no ssh-keygen: apt-get install openssh-client"
)
needs_cyclonedx = pytest.mark.skipif(
    not (Path(sys.executable).parent / "cyclonedx-py").is_file(), reason="no cyclonedx-bom: make .venv/.dev"
)


def load() -> ModuleType:
    specification = importlib.util.spec_from_file_location("release", ROOT / "deploy" / "release.py")
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def key_of(directory: Path, name: str = "release") -> Path:
    path = directory / name
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(path)], check=True)
    return path


def verifies(dist: Path, key: Path, namespace: str = "hilfit-release") -> bool:
    """As the documentation says it: with the public key alone, by the program of OpenSSH."""
    signers = key.with_name("allowed_signers")
    signers.write_text(f"releaser {key.with_suffix('.pub').read_text()}")
    sums, signature = dist / "SHA256SUMS", dist / "SHA256SUMS.sig"
    command = ["ssh-keygen", "-Y", "verify", "-f", signers, "-I", "releaser", "-n", namespace, "-s", signature]
    return subprocess.run(list(map(str, command)), input=sums.read_bytes(), capture_output=True).returncode == 0


@needs_ssh
def test_a_signature_verifies_and_nothing_else_does(tmp_path: Path) -> None:
    release, dist = load(), tmp_path / "dist"
    dist.mkdir()
    files = [dist / "b.whl", dist / "a.tar.gz"]
    for path in files:
        path.write_bytes(path.name.encode() * 1000)
    key, other = key_of(tmp_path), key_of(tmp_path, "other")
    release.sign(files, key)
    sums = (dist / "SHA256SUMS").read_text()
    assert sums == "".join(f"{hashlib.sha256(p.read_bytes()).hexdigest()}  {p.name}\n" for p in sorted(files))
    assert subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=dist).returncode == 0
    assert verifies(dist, key)
    assert not verifies(dist, other)
    assert not verifies(dist, key, "something-else")
    (dist / "SHA256SUMS").write_text(sums.replace("a", "b", 1))
    assert not verifies(dist, key)


def test_without_a_key_nothing_is_made_and_it_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    release = load()
    assert release.main(["--key", "", "--dist", str(tmp_path / "dist")]) == 2
    assert "make release KEY=" in capsys.readouterr().err
    assert release.main(["--key", str(tmp_path / "none"), "--dist", str(tmp_path / "dist")]) == 2
    assert "is no file" in capsys.readouterr().err
    assert not (tmp_path / "dist").exists()


def small_checkout(place: Path) -> Path:
    """A project of a few lines in a repository, with the lock file of our page."""
    (place / "server" / "web").mkdir(parents=True)
    shutil.copy(ROOT / "server" / "web" / "package-lock.json", place / "server" / "web")
    (place / "own.py").write_text("VALUE = 1\n")
    (place / ".gitignore").write_text("dist/\n")
    (place / "pyproject.toml").write_text(
        '[build-system]\nrequires = ["setuptools>=77"]\nbuild-backend = "setuptools.build_meta"\n'
        '[project]\nname = "hilfit"\nversion = "1.2.3"\nlicense = "Apache-2.0"\n'
        '[tool.setuptools]\npy-modules = ["own"]\n'
    )
    commit(place)
    return place


def commit(place: Path) -> None:
    name = ["-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "commit.gpgsign=false"]
    for command in (["init", "-q"], ["add", "-A"], [*name, "commit", "-qm", "x"]):
        subprocess.run(["git", *command], cwd=place, check=True)


def small_environment(place: Path) -> Path:
    """An environment that has metadata of two packages, one of them from a file of this computer."""
    venv.create(place, with_pip=False)
    (packages,) = place.glob("lib/python*/site-packages")
    for name in ("numpy", "pydantic"):
        own = distribution(name)._path  # type: ignore[attr-defined]
        shutil.copytree(own, packages / own.name)
    (found,) = packages.glob("numpy-*")
    (found / "direct_url.json").write_text('{"url": "file:///somewhere/secret.whl", "archive_info": {}}')
    return place / "bin" / "python"


@needs_ssh
@needs_cyclonedx
@pytest.mark.slow
def test_a_release_is_of_the_commit_and_says_what_is_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    release, key = load(), key_of(tmp_path)
    root = small_checkout(tmp_path / "checkout")
    monkeypatch.setattr(release, "ROOT", root)
    dist = root / "dist"
    arguments = ["--key", str(key), "--dist", str(dist), "--environment", str(small_environment(tmp_path / "small"))]

    (root / "more.py").write_text("")
    assert release.main(arguments) == 2
    assert "more.py is in no commit" in capsys.readouterr().err
    (root / "more.py").unlink()

    assert release.main(arguments) == 0, capsys.readouterr().err
    names = {"hilfit-1.2.3-py3-none-any.whl", "hilfit-1.2.3.tar.gz", "hilfit-1.2.3.cdx.json"}
    assert {path.name for path in dist.iterdir()} == {*names, "SHA256SUMS", "SHA256SUMS.sig"}
    assert verifies(dist, key)
    assert subprocess.run(["sha256sum", "--check", "--quiet", "SHA256SUMS"], cwd=dist).returncode == 0
    bill: dict[str, Any] = json.loads((dist / "hilfit-1.2.3.cdx.json").read_text())
    assert bill["bomFormat"] == "CycloneDX"
    assert bill["metadata"]["component"]["name"] == "hilfit"
    found = {component["name"]: component for component in bill["components"]}
    assert {"numpy", "pydantic", "preact", "uplot"} <= set(found)
    assert found["numpy"]["version"] == distribution("numpy").version
    assert all(found[name]["licenses"] for name in ("numpy", "pydantic", "preact", "uplot"))
    assert found["preact"]["purl"].startswith("pkg:npm/preact@")
    assert "vite" not in found, "what only builds the page is not in it"
    references = {component["bom-ref"] for component in bill["components"]}
    assert {entry["ref"] for entry in bill["dependencies"]} >= references
    assert "file:" not in json.dumps(bill)
    assert str(tmp_path) not in json.dumps(bill)

    assert release.main(arguments) == 2
    assert "is not empty" in capsys.readouterr().err


def test_the_page_says_the_same_libraries_as_its_own_description() -> None:
    described = json.loads((ROOT / "server" / "web" / "package.json").read_text())["dependencies"]
    assert set(described) <= {component["name"] for component in load().page_components()}
