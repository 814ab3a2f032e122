"""What stage 2 knows beside its rows, for estimators that need more than ``A`` and ``b``.

An estimator that has a method ``within(stage)`` is asked for itself *within* that stage before it fits: it gives back
an estimator that carries what it took from there. One that has none is used as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry
from fitting.estimators.base import Estimator
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
    prior : what is believed of the base parameters beforehand, or None
    """

    geometry: Geometry
    base: BaseParameters
    colour: Colour = "hac"
    prior: BodyPrior | None = None


@runtime_checkable
class TakesStage(Protocol):
    """An estimator that takes something from stage 2."""

    def within(self, stage: StageTwo) -> Estimator:
        """This estimator with what it needs of the stage.

        Raises
        ------
        InputError
            If the stage lacks what it cannot do without; one line says what to give.
        """
        ...


def within(estimator: Estimator, stage: StageTwo) -> Estimator:
    """The estimator, with what it takes from the stage."""
    return estimator.within(stage) if isinstance(estimator, TakesStage) else estimator
