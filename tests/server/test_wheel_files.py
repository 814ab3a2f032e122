"""What is in a wheel: every file beside the code is named by pyproject's package data, and every package is found."""

from __future__ import annotations

import tomllib
from fnmatch import fnmatch
from pathlib import Path

ROOT = Path(__file__).parents[2]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
PACKAGES = [ROOT / pattern.rstrip("*") for pattern in SETUPTOOLS["packages"]["find"]["include"]]
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
    everywhere = SOURCES not in path.parents and any(fnmatch(path.name, pattern) for pattern in data["*"])
    top = path.relative_to(ROOT).parts[0]
    # To setuptools, unlike fnmatch, a star does not cross directories.
    own = any(path in set((ROOT / top).glob(pattern)) for pattern in data.get(top, ()))
    return everywhere or own


def test_every_file_that_is_no_code_is_package_data() -> None:
    others = [path for path in files() if path.suffix != ".py"]
    assert {path.suffix for path in others} >= {".yaml", ".eds", ".j2", ".css", ".html", ".js", ".typed"}
    assert [str(path.relative_to(ROOT)) for path in others if not packed(path)] == []


def test_every_package_says_that_it_has_types() -> None:
    assert [package.name for package in PACKAGES if not (package / "py.typed").is_file()] == []
