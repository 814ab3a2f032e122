"""Which estimator stage 2 uses, from an identification's options."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from daq.errors import InputError
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.geometry import Geometry
from fitting.estimators import Colour, Estimator, StageTwo, estimator, estimator_ids, within
from fitting.loop.session import Options
from fitting.regression.body_prior import BodyPrior, read_body_prior

#: The joint refit of both stages beside a plausible arm: no plug-in, because it is the loop's own fit.
JOINT = "gls"
_COLOURS: dict[str, Colour] = {"hac": "hac", "bootstrap": "bootstrap", "white": "white"}


@dataclass(frozen=True)
class Choice:
    """An estimator with what it needs.

    Attributes
    ----------
    name : id, as in the report
    estimator : None for the joint refit; stage 2 by itself then is ordinary least squares
    colour : which covariance
    prior : of the base parameters, or None
    """

    name: str
    estimator: Estimator | None
    colour: Colour
    prior: BodyPrior | None


def chosen(options: Options, base: BaseParameters, geometry: Geometry) -> Choice:
    """The estimator that the options ask for, found, and fit to be used on this arm.

    Raises
    ------
    InputError
        One line: no such estimator or covariance, an extra that is not installed, a prior that is missing or wrong.
    """
    colour: Colour = _COLOURS.get(options.covariance, "white")
    if options.covariance not in _COLOURS:
        raise InputError(f"there is no covariance '{options.covariance}'; use one of {', '.join(_COLOURS)}")
    prior = None if options.prior is None else read_body_prior(Path(options.prior), base)
    if options.estimator == JOINT:
        if prior is not None:
            raise InputError(f"{options.prior}: a prior is used by the estimators 'ridge' and 'possible' only")
        return Choice(JOINT, None, colour, None)
    if options.estimator not in estimator_ids():
        raise InputError(
            f"there is no estimator '{options.estimator}'; use one of {', '.join(sorted((JOINT, *estimator_ids())))}"
        )
    found = estimator(options.estimator)
    # What it cannot do without is missed now and not after the recordings are prepared; rows come later.
    within(found, StageTwo(geometry, base, colour, prior))
    return Choice(options.estimator, found, colour, prior)
