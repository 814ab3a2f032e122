"""Forecast of what planned motions will show, before they are made: of each effect, and of each parameter.

The motions go through the same filters, columns and projections as recordings will (:mod:`fitting.planning.planned`,
:mod:`fitting.planning.detection`, :mod:`fitting.regression.identifiability`). Forces, which many columns live on, come
from a report of an earlier identification or from a guess (:mod:`fitting.planning.guess`); shares of columns that
survive hardly depend on it, sizes in newtons are as good as the noise that is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from daq.motion_files import Motion
from daq.recordings.recording import Recording
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.joint_side import at_joints
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.planning.detection import Visibility, typical_terms, visibilities
from fitting.planning.guess import Guess
from fitting.planning.planned import planned_segment, planned_views, usual_chambers
from fitting.regression.design import NoiseModel, build_design, whitened
from fitting.regression.identifiability import ParameterVerdict, parameter_verdicts, statement
from fitting.regression.prior import mass_prior, with_prior
from fitting.selection.evidence import least_gain
from fitting.signals.filters import FilterBank, filter_bank
from fitting.signals.preparation import PositionNoise, Segment, position_noise, segments_of
from fitting.signals.spectrum import whitening

#: Bandwidth of an identification of slow motions, Hz (at most an eighth of the rate).
BANDWIDTH = 3.0
#: Noise of a smoothed speed that is assumed where no recording determines, as a share of the joint's top speed.
_SPEED_NOISE = 2e-4
_POWER = 0.95  # with which the smallest effects are found
_BACK_PRESSURE = 5.0e5  # Pa: what a valve usually keeps in the chamber that is emptied


@dataclass(frozen=True)
class Forecast:
    """Forecast of what a plan will show.

    Attributes
    ----------
    visibilities : of every effect on every joint, in one shape of its grid
    choices : for each, the number of shapes and neighbours that a search will choose from
    verdicts : of every parameter
    joints : names of the joints
    """

    visibilities: tuple[Visibility, ...]
    choices: tuple[int, ...]
    verdicts: tuple[ParameterVerdict, ...]
    joints: tuple[str, ...]


def forecast(
    machine: Machine,
    base: BaseParameters,
    motions: Sequence[Motion],
    guess: Guess,
    effects: Sequence[Effect],
    recordings: Sequence[Recording] = (),
) -> Forecast:
    """Forecast a set of planned motions, together with the motion that is recorded already; no efforts are looked at.

    The plan is pinned and unpinned motions, and ``guess`` has the parameters and the noise to plan with.

    Raises
    ------
    InputError
        If a motion is shorter than the filters.
    """
    machine, recordings = at_joints(machine, recordings)
    bank = filter_bank(machine.rate_hz, min(BANDWIDTH, machine.rate_hz / 8))
    noise = _position_noise(machine, recordings, bank)
    segments: list[Segment] = list(segments_of(machine, recordings, bank, noise=noise)) if recordings else []
    first = 1 + max((segment.recording for segment in segments), default=-1)
    segments += [planned_segment(machine, bank, noise, m, first + k) for k, m in enumerate(motions)]
    segments = [replace(segment, temperature=None) for segment in segments]  # of a plan nothing is known of it
    design = build_design(machine, base, bank, noise, segments)
    model = white_noise(guess.noise, bank)
    every = range(len(segments))
    hydraulics = machine.hydraulics
    back = max(_BACK_PRESSURE, 0.0 if hydraulics is None else hydraulics.tank_pressure)
    views = planned_views(design, guess.theta, usual_chambers(machine, back))
    prior = mass_prior(machine)
    rows = with_prior(whitened(design, model, every), design.parameters, prior)
    terms = typical_terms(machine, effects, views[0])
    found = visibilities(design, model, views, rows, every, [term for term, _ in terms])
    return Forecast(
        found,
        tuple(choices for _, choices in terms),
        parameter_verdicts(design, model, every, guess.theta, prior),
        tuple(joint.name for joint in machine.joints),
    )


def white_noise(std: FloatArray, bank: FilterBank) -> NoiseModel:
    """Return noise white before the filters, of a standard deviation (n,) after them."""
    sample = np.random.default_rng(0).normal(size=round(2000 * bank.rate_hz / bank.bandwidth_hz))
    sample /= np.std(bank.reduce(sample))
    return NoiseModel(tuple(whitening([max(float(s), 1e-12) * sample], bank) for s in std), False)


def _position_noise(machine: Machine, recordings: Sequence[Recording], bank: FilterBank) -> tuple[PositionNoise, ...]:
    if recordings:
        return position_noise(machine, recordings, bank)
    result = []
    for joint in machine.joints:
        top = joint.limits.velocity * (0.1 if joint.cylinder is not None else 1.0)  # a lever of some 0.1 m
        std = _SPEED_NOISE * top / bank.speed_noise(1.0)
        result.append(PositionNoise(std, bank.speed_noise(std), bank.acceleration_noise(std)))
    return tuple(result)


def forecast_to_json(found: Forecast, guess: Guess) -> dict[str, Any]:
    """Return the forecast as plain JSON; ``smallest`` is None where nothing of an effect survives."""
    effects = []
    for visibility, choices in zip(found.visibilities, found.choices, strict=True):
        needed = least_gain(max(visibility.parameters, 1), choices)
        smallest = visibility.smallest(needed, _POWER)
        joint = visibility.term.joint
        effects.append(
            {
                "id": visibility.term.id,
                "joint": None if joint is None else found.joints[joint],
                "surviving": visibility.surviving,
                "smallest": smallest if np.isfinite(smallest) else None,
                "parameter": visibility.parameter,
                "unit": visibility.unit,
            }
        )
    return {
        "basis": guess.statement,
        "measured": guess.measured,
        "power": _POWER,
        "effects": effects,
        "parameters": [own.to_json() for own in found.verdicts],
        "parameters_statement": statement(found.verdicts),
    }
