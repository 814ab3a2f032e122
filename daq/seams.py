"""Where other packages add to hilfit: bus drivers, effects, estimators, each a group of entry points with unique names.

What one has to be is said by :class:`daq.drivers.base.Driver`, `fitting.effects.base.Effect` and
`fitting.estimators.base.Estimator`, and tried by the ``conformance`` module beside each.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from daq.errors import InputError


@dataclass(frozen=True)
class Seam:
    """One kind of plug-in.

    Attributes
    ----------
    group : of entry points, as it stands in a ``pyproject.toml``
    kind : what one of them is called in an error
    """

    group: str
    kind: str

    def names(self) -> tuple[str, ...]:
        """List the names of all that are installed, sorted."""
        return tuple(sorted(point.name for point in self._points()))

    def all(self, wanted: Any) -> tuple[Any, ...]:
        """Make the objects of all that are installed by :meth:`make`, sorted by name; the metadata is read once."""
        points = self._points()
        return tuple(self._made(point, wanted) for point in sorted(points, key=lambda point: point.name))

    def load(self, name: str) -> Any:
        """Load what the entry point names.

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

    def _points(self) -> list[EntryPoint]:
        points = list(entry_points(group=self.group))
        name, count = max(Counter(point.name for point in points).items(), key=lambda item: item[1], default=("", 0))
        if count > 1:
            values = [point.value for point in points if point.name == name]
            raise InputError("daq.seam_names_twice", count=count, name=name, kind=self.kind, values=values)
        return points


DRIVERS = Seam("hilfit.drivers", "driver")
EFFECTS = Seam("hilfit.effects", "effect")
ESTIMATORS = Seam("hilfit.estimators", "estimator")
