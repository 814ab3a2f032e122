"""Estimators by id, as they are installed."""

from __future__ import annotations

from daq.seams import ESTIMATORS
from fitting.estimators.base import Estimator


def estimator_ids() -> tuple[str, ...]:
    """Ids of all installed estimators, sorted."""
    return ESTIMATORS.names()


def estimator(name: str) -> Estimator:
    """The estimator with this id (``InputError``, one line, if there is none or it is none)."""
    made: Estimator = ESTIMATORS.make(name, Estimator)
    return made
