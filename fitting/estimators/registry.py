"""Estimators by id, from the entry-point group ``hilfit.estimators``."""

from __future__ import annotations

from importlib.metadata import entry_points

from daq.errors import InputError
from fitting.estimators.base import Estimator

GROUP = "hilfit.estimators"


def estimator_ids() -> tuple[str, ...]:
    """Ids of all registered estimators, sorted."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def estimator(name: str) -> Estimator:
    """The estimator with this id.

    Raises
    ------
    InputError
        One line, if there is none, it cannot be imported, or it is no estimator.
    """
    found = [point for point in entry_points(group=GROUP) if point.name == name]
    if not found:
        raise InputError(f"there is no estimator '{name}'; use one of {', '.join(estimator_ids())}")
    try:
        made = found[0].load()()
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"estimator '{name}' ({found[0].value}) cannot be loaded: {error}; install what it needs"
        ) from None
    if not isinstance(made, Estimator):
        raise InputError(f"estimator '{name}' ({found[0].value}) has no `name` and `fit`; it is not an estimator")
    return made
