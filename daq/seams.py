"""Where bus drivers, effects and estimators are found: names are unique in each kind.

hilfit's own effects and estimators are whatever is in their folder, one file each, and its drivers are those of
:data:`daq.machine.buses.BUSES`; those of other packages are a group of entry points. What one has to be is defined by
:class:`daq.drivers.base.Driver`, `fitting.effects.base.Effect` and `fitting.estimators.base.Estimator`, and tried by
the ``conformance`` module beside each.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from typing import Any

from daq.errors import InputError


@dataclass(frozen=True)
class Seam:
    """One kind of plug-in.

    Attributes
    ----------
    group : of entry points, as it stands in a ``pyproject.toml``
    kind : what one of them is called in an error
    folder : package of hilfit's own: of each module the class that says it is called as the module; "": there are none
    called : attribute of a class in which it says so
    """

    group: str
    kind: str
    folder: str = ""
    called: str = "name"

    def names(self) -> tuple[str, ...]:
        """List the names of all that are installed, sorted."""
        return tuple(point.name for point in self._points())

    def all(self, wanted: Any) -> tuple[Any, ...]:
        """Make the objects of all that are installed by :meth:`make`, sorted by name; the metadata is read once."""
        return tuple(self._made(point, wanted) for point in self._points())

    def load(self, name: str) -> Any:
        """Load what has that name.

        Raises
        ------
        InputError
            One line, if there is none of that name, or it cannot be imported.
        """
        return self._loaded(self._point(name))

    def make(self, name: str, wanted: Any) -> Any:
        """Make an object of the named class without arguments: of type ``wanted`` (``InputError`` if not)."""
        return self._made(self._point(name), wanted)

    def _point(self, name: str) -> EntryPoint:
        found = {point.name: point for point in self._points()}
        if name not in found:
            raise InputError("daq.seam_none", kind=self.kind, name=name, names=sorted(found))
        return found[name]

    def _loaded(self, point: EntryPoint) -> Any:
        try:
            return point.load()
        except (ImportError, AttributeError) as error:
            raise InputError(
                "daq.seam_not_loaded", kind=self.kind, name=point.name, place=point.value, error=error
            ) from error

    def _made(self, point: EntryPoint, wanted: Any) -> Any:
        loaded = self._loaded(point)
        try:
            made = loaded()
        except TypeError as error:  # of an abstract class that lacks a method
            raise InputError("daq.seam_not_made", kind=self.kind, name=point.name, error=error) from error
        if not isinstance(made, wanted):
            type_name = f"{wanted.__module__}.{wanted.__qualname__}"
            raise InputError("daq.seam_other_type", kind=self.kind, name=point.name, type_name=type_name)
        return made

    def _own(self) -> Iterator[EntryPoint]:
        for found in iter_modules(import_module(self.folder).__path__) if self.folder else ():
            module = EntryPoint(found.name, f"{self.folder}.{found.name}", self.group)
            for kind in vars(self._loaded(module)).values():
                if isinstance(kind, type) and getattr(kind, self.called, None) == found.name:
                    yield EntryPoint(found.name, f"{module.value}:{kind.__qualname__}", self.group)

    def _points(self) -> list[EntryPoint]:
        # Of an entry point that leads into the folder only an older installation still knows.
        others = (at for at in entry_points(group=self.group) if not at.value.startswith(f"{self.folder}."))
        points = sorted((*self._own(), *others), key=lambda at: (at.name, at.value))
        name, count = max(Counter(point.name for point in points).items(), key=lambda item: item[1], default=("", 0))
        if count > 1:
            values = [point.value for point in points if point.name == name]
            raise InputError("daq.seam_names_twice", count=count, name=name, kind=self.kind, values=values)
        return points


DRIVERS = Seam("hilfit.drivers", "driver")
EFFECTS = Seam("hilfit.effects", "effect", "fitting.effects", "id")
ESTIMATORS = Seam("hilfit.estimators", "estimator", "fitting.estimators")
