"""What is in a wheel: every file beside the code, no benchmark; what is installed from it runs without a checkout."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx2
import pytest

from fitting.effects import effects

ROOT = Path(__file__).parents[2]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
PACKAGES = sorted({ROOT / pattern.rstrip("*.") for pattern in SETUPTOOLS["packages"]["find"]["include"]})
SOURCES = ROOT / "server" / "web"


def files() -> list[Path]:
    """Files of the packages but for the sources of the page, which are built into ``server/web/dist``."""
    found = (path for package in PACKAGES for path in package.rglob("*") if path.is_file())
    return [
        path
        for path in found
        if "__pycache__" not in path.parts and (SOURCES not in path.parents or SOURCES / "dist" in path.parents)
    ]


def packed(path: Path) -> bool:
    """Whether setuptools takes a file; patterns of ``*`` are for the files of every package."""
    data = SETUPTOOLS["package-data"]
    everywhere = SOURCES not in path.parents and any(path.match(pattern) for pattern in data["*"])
    packages = ((ROOT.joinpath(*name.split(".")), patterns) for name, patterns in data.items() if name != "*")
    # To setuptools, unlike fnmatch, a star does not cross directories.
    own = any(path in set(package.glob(pattern)) for package, patterns in packages for pattern in patterns)
    return everywhere or own


def test_every_file_that_is_no_code_is_package_data() -> None:
    others = [path for path in files() if path.suffix != ".py"]
    assert {path.suffix for path in others} >= {".yaml", ".eds", ".j2", ".css", ".html", ".js", ".typed"}
    assert [str(path.relative_to(ROOT)) for path in others if not packed(path)] == []


def test_every_package_says_that_it_has_types() -> None:
    assert [package.name for package in PACKAGES if not (package / "py.typed").is_file()] == []


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what pip installs of the wheel, without dependencies; the wheel is made of copied sources.

    In the checkout setuptools would leave ``build/`` behind, and take what an earlier wheel left there.
    """
    base = tmp_path_factory.mktemp("wheel")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (base / "source").mkdir(exist_ok=True)
        shutil.copy(ROOT / name, base / "source")
    for package in PACKAGES:
        unwanted = shutil.ignore_patterns("__pycache__", "node_modules")
        shutil.copytree(package, base / "source" / package.name, ignore=unwanted)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index"]
    made = ["wheel", str(base / "source"), *offline, "--no-build-isolation", "--wheel-dir", str(base)]
    subprocess.run([*pip, *made], check=True, cwd=base)
    (wheel,) = base.glob("hilfit-*.whl")
    put = ["install", str(wheel), *offline, "--no-compile", "--target", str(base / "installed")]
    subprocess.run([*pip, *put], check=True, cwd=base)
    return base / "installed"


def environment(installed: Path) -> dict[str, str]:
    """Of a process that finds hilfit in the folder before the checkout that its interpreter knows."""
    return {**os.environ, "PYTHONPATH": str(installed), "PYTHONDONTWRITEBYTECODE": "1"}


@contextmanager
def served(installed: Path, data_dir: Path) -> Iterator[httpx2.Client]:
    """A client of an installed service."""
    command = [str(installed / "bin" / "hilfit"), "serve", "--port", "0", "--json", "--data-dir", str(data_dir)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, env=environment(installed), cwd=data_dir.parent, text=True
    ) as process:
        try:
            assert process.stdout is not None
            with httpx2.Client(base_url=json.loads(process.stdout.readline())["url"], timeout=30) as client:
                yield client
        finally:
            process.terminate()


@pytest.mark.slow
def test_a_wheel_holds_the_packages_and_no_benchmark(installed: Path) -> None:
    names = {path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {package.name for package in PACKAGES} | {"bin"}
    (points,) = installed.glob("hilfit-*.dist-info/entry_points.txt")
    assert "hilfit.commands" not in points.read_text()
    missing = [path for path in files() if not (installed / path.relative_to(ROOT)).is_file()]
    assert missing == []


@pytest.mark.slow
def test_the_installed_command_is_the_wheels_own_and_shows_its_help(installed: Path, tmp_path: Path) -> None:
    def run(*command: str) -> str:
        done = subprocess.run(
            command, env=environment(installed), cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return done.stdout

    shown = run(str(installed / "bin" / "hilfit"), "--help")
    assert all(f" {command} " in shown for command in ("demo", "identify", "serve"))
    listed = json.loads(run(str(installed / "bin" / "hilfit"), "effects", "list", "--json"))
    assert [own["id"] for own in listed] == [own.id for own in effects()]
    assert run(sys.executable, "-c", "import server.commands.command_line as c; print(c.__file__)").startswith(
        str(installed)
    )


@pytest.mark.slow
def test_the_page_of_an_installed_service_is_whole(installed: Path, tmp_path: Path) -> None:
    with served(installed, tmp_path / "data") as client:
        page = client.get("/")
        assert page.status_code == 200 and "<title>hilfit</title>" in page.text
        parts = re.findall(r'(?:src|href)="\./((?!api/)[^"]+)"', page.text)
        assert len(parts) >= 3
        for name in parts:
            answer = client.get(f"/{name}")
            assert (answer.status_code, answer.content) == (200, (SOURCES / "dist" / name).read_bytes())
