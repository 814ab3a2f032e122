"""Knowledge of stage 2 beside its rows, for estimators that need more than ``A`` and ``b``.

An estimator that has a method ``within(stage)`` is asked for itself *within* that stage before it fits: it gives back
an estimator that carries what it took from there. One that has none is used as it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self, runtime_checkable

import numpy.typing as npt

from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry
from fitting.estimators.base import Estimate, Estimator, Rows, check_rows
from fitting.estimators.covariance import Colour
from fitting.regression.body_prior import BodyPrior


@dataclass(frozen=True)
class StageTwo:
    """Circumstances of one fit of the base parameters; ``R`` rows, ``p = len(base)`` columns.

    Attributes
    ----------
    geometry : the arm
    base : its base parameters, in the order of the columns
    colour : which covariance is asked for
    prior : of the base parameters, or None
    """

    geometry: Geometry
    base: BaseParameters
    colour: Colour = "hac"
    prior: BodyPrior | None = None


@runtime_checkable
class _TakesStage(Protocol):
    """An estimator that takes something from stage 2."""

    def within(self, stage: StageTwo) -> Estimator:
        """Return this estimator with what it needs of the stage.

        Raises
        ------
        InputError
            If the stage lacks what it cannot do without; one line names what to give.
        """
        ...


@dataclass(frozen=True)
class RowsEstimator(ABC):
    """Base of the estimators here: checks the rows, and takes from stage 2 which covariance is asked for.

    Attributes
    ----------
    name : as in the report
    colour : how the covariance treats coloured residuals (:mod:`fitting.estimators.covariance`)
    """

    name: ClassVar[str]
    colour: Colour = "white"

    def within(self, stage: StageTwo) -> Self:
        """Return the same with what it needs of the stage; see :class:`_TakesStage`."""
        return replace(self, colour=stage.colour)

    def fit(
        self,
        A: npt.ArrayLike,
        b: npt.ArrayLike,
        *,
        groups: npt.ArrayLike | None = None,
        weights: npt.ArrayLike | None = None,
    ) -> Estimate:
        """Fit rows; see :class:`fitting.estimators.base.Estimator`."""
        return self.solved(check_rows(A, b, groups, weights))

    @abstractmethod
    def solved(self, rows: Rows) -> Estimate:
        """Return the estimate of checked rows."""


def within(estimator: Estimator, stage: StageTwo) -> Estimator:
    """Return the estimator, with what it takes from the stage."""
    return estimator.within(stage) if isinstance(estimator, _TakesStage) else estimator
