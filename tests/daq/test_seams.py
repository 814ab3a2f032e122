"""Seams: what is in a folder is found, and what other packages add; what cannot be used is one clear line."""

from __future__ import annotations

import sys
import tomllib
from abc import ABC, abstractmethod
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from daq import InputError
from daq.seams import DRIVERS, EFFECTS, ESTIMATORS, Seam

NAMED = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"].get("entry-points", {})
WIDGETS = Seam("test.widgets", "widget")


class Widget(ABC):
    """What the tests plug in."""

    @abstractmethod
    def turn(self) -> None:
        """What :class:`Half` lacks."""


class Whole(Widget):
    def turn(self) -> None:
        pass


class Half(Widget):
    pass


def plug_in(monkeypatch: pytest.MonkeyPatch, **values: str) -> None:
    points = [EntryPoint(name, value, WIDGETS.group) for name, value in values.items()]
    monkeypatch.setattr("daq.seams.entry_points", lambda group: points)


@pytest.mark.slow
@pytest.mark.parametrize("seam", [DRIVERS, EFFECTS, ESTIMATORS], ids=lambda seam: seam.kind)
def test_every_plug_in_that_is_installed_can_be_loaded(seam: Seam) -> None:
    assert seam.group not in NAMED, "hilfit's own are found in their folder, or in BUSES"
    for name in seam.names():
        assert callable(seam.load(name))


def test_a_plug_in_of_another_package_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, whole=f"{__name__}:Whole")
    assert WIDGETS.names() == ("whole",)
    assert isinstance(WIDGETS.make("whole", Widget), Whole)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (f"{__name__}:Nobody", "widget 'mine' .*Nobody.* cannot be loaded: .*reinstall the package"),
        ("no_such_module:X", "cannot be loaded: No module named 'no_such_module'"),
        (f"{__name__}:Half", "widget 'mine' cannot be made: .*turn"),
        ("pathlib:Path", rf"widget 'mine' is no {__name__}.Widget; its package"),
    ],
)
def test_what_cannot_be_used_is_one_line(monkeypatch: pytest.MonkeyPatch, value: str, says: str) -> None:
    plug_in(monkeypatch, mine=value)
    with pytest.raises(InputError, match=says) as caught:
        WIDGETS.make("mine", Widget)
    assert "\n" not in str(caught.value)


def test_a_name_that_is_not_there_is_told_with_those_that_are(monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, wheel="a:B", axle="a:C")
    with pytest.raises(InputError, match="there is no widget 'gear'; use one of axle, wheel"):
        WIDGETS.load("gear")


def test_two_of_one_name_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [EntryPoint("wheel", value, WIDGETS.group) for value in ("one:Wheel", "other:Wheel")]
    monkeypatch.setattr("daq.seams.entry_points", lambda group: points)
    with pytest.raises(InputError, match="2 of the name 'wheel' among the widgets: one:Wheel and other:Wheel"):
        WIDGETS.names()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Seam:
    """A seam with a folder of its own: two widgets, and modules that are none."""
    (tmp_path / "own_widgets").mkdir()
    texts = {
        "__init__": "",
        "base": f"from {__name__} import Half, Whole\n",
        "cog": "from own_widgets.base import Whole\nclass Cog(Whole): id = 'cog'\n",
        "gear": "from own_widgets.cog import Cog\nclass Gear(Cog): id = 'gear'\nclass Other(Cog): id = 'other'\n",
    }
    for name, text in texts.items():
        (tmp_path / "own_widgets" / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "own_widgets"]:
        monkeypatch.delitem(sys.modules, name)
    return replace(WIDGETS, folder="own_widgets", called="id")


def test_what_is_in_the_folder_is_found_beside_other_packages(folder: Seam, monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, whole=f"{__name__}:Whole", axle="own_widgets.axle:Axle", cog="own_widgets.cog:Cog")
    assert folder.names() == ("cog", "gear", "whole"), "an older installation's entry points into the folder are passed"
    assert [type(made).__name__ for made in folder.all(Widget)] == ["Cog", "Gear", "Whole"]


def test_the_name_of_one_in_the_folder_is_taken(folder: Seam, monkeypatch: pytest.MonkeyPatch) -> None:
    plug_in(monkeypatch, gear="others:Gear")
    with pytest.raises(InputError, match=r"2 of the name 'gear' .*: others:Gear and own_widgets.gear:Gear; uninstall"):
        folder.names()


def test_a_file_of_the_folder_that_cannot_be_imported_is_one_line(folder: Seam, tmp_path: Path) -> None:
    (tmp_path / "own_widgets" / "nut.py").write_text("from own_widgets.base import Nobody\n")
    with pytest.raises(InputError, match=r"widget 'nut' \(own_widgets.nut\) cannot be loaded: cannot import name"):
        folder.names()
