"""The model of an identification: everything that its prediction is made of, and nothing else."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import BaseParameters
from fitting.arm.joint_side import at_joints
from fitting.arrays import FloatArray
from fitting.effects.base import Effect, Ranges
from fitting.model.tails import Tail
from fitting.regression.design import Parameters
from fitting.regression.drive import drive_names, drive_units, effort_unit
from fitting.residual.laws import Law
from fitting.residual.stored_terms import corrections_from_json
from fitting.residual.terms import Term, delays
from fitting.residual.views import RodLaw
from fitting.signals.corrections import Corrections
from fitting.signals.filters import FilterBank, filter_bank
from fitting.signals.preparation import PositionNoise

#: The number of a recording that the identification has not seen.
FOREIGN = -2
#: Signals of a law that needs the motion before a moment.
_MEMORY = frozenset({"time_since_reversal", "distance_since_reversal", "force_rate"})


@dataclass(frozen=True)
class Source:
    """One recording that the model was identified from."""

    role: str
    file: str
    sha256: str
    samples: int


@dataclass(frozen=True)
class Provenance:
    """Where a model comes from.

    Attributes
    ----------
    created : UTC, ISO 8601
    software : versions by name
    data : the recordings, in the order in which effects count them
    verdict : the report's
    calibration : id of the service's calibration, None outside a service
    """

    created: str
    software: Mapping[str, str]
    data: tuple[Source, ...]
    verdict: str
    calibration: str | None = None


@dataclass(frozen=True)
class Pass:
    """One of the fits that follow each other: columns of effects hold the force that the fit before predicts.

    Attributes
    ----------
    theta : (p,) parameters: drive, base, effects (none in the first of several)
    ranges : per joint the ranges of its signals that effects count from
    rods : per joint its expected rod pressure, None where no pressure is measured
    """

    theta: FloatArray
    ranges: tuple[Ranges, ...]
    rods: tuple[RodLaw | None, ...]


@dataclass(frozen=True)
class Seen:
    """Moments of the validation recordings, (M, n) each.

    Attributes
    ----------
    q, qd, qdd : the motion
    effort : measured joint efforts through the identification filter, N m or N
    error : measured minus predicted ones
    """

    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    effort: FloatArray
    error: FloatArray


@dataclass(frozen=True, eq=False)  # arrays are not compared: a model is itself
class ArmModel:
    """A corrected model of an arm.

    Attributes
    ----------
    machine : as the machine file has it
    steps : what was learnt about positions and linkages, step by step
        (:func:`fitting.residual.stored_terms.step_to_json`)
    base : the base parameters
    bandwidth_hz : of the identification filter
    noise : per joint the noise of its position; the speed's makes friction smooth at zero speed
    terms : effects and laws that were added
    passes : the fits, the last one being the model
    covariance : (p, p) of the last one's parameters, as efforts have it
    told : (p,) False for a parameter that the recordings could not determine (its value is 0)
    residual_std : (n,) standard deviation of measured minus predicted drive effort on the recordings of the fit, at
        the full rate, N at a piston; without single seconds that are far out
        (:func:`fitting.model.handover.without_single`)
    provenance : where it comes from
    tails : per joint what the scores of an unchanged machine do (:mod:`fitting.model.uses.overload`); None: not known
    hidden : (p,) variance of parameters that laws of unknown physics make up for in the efforts; None: nothing
    errors : (n,) root mean square error on the validation recordings, N m or N; not a number where nothing moved
    coverage : (n,) share of the moving samples of those in the 95 % band; not a number where nothing moved
    rests : fits without terms that some formats cannot hold
    seen : moments of the validation recordings
    temperature : coldest and warmest oil of the recordings of the fit, K; None where nobody measured it
    filters : other filters than those of the identification; None: those
    """

    machine: Machine
    steps: tuple[Mapping[str, Any], ...]
    base: BaseParameters
    bandwidth_hz: float
    noise: tuple[PositionNoise, ...]
    terms: tuple[Term, ...]
    passes: tuple[Pass, ...]
    covariance: FloatArray = field(repr=False)
    told: npt.NDArray[np.bool_] = field(repr=False)
    residual_std: FloatArray
    provenance: Provenance
    tails: tuple[Tail, ...] | None = None
    hidden: FloatArray | None = field(default=None, repr=False)
    errors: FloatArray | None = None
    coverage: FloatArray | None = None
    rests: tuple[ArmModel, ...] = field(default=(), repr=False)
    seen: Seen | None = field(default=None, repr=False)
    temperature: tuple[float, float] | None = None
    filters: FilterBank | None = field(default=None, repr=False)

    @property
    def theta(self) -> FloatArray:
        """The parameters (p,): drive, base, effects."""
        return self.passes[-1].theta

    @property
    def std(self) -> FloatArray:
        """Their standard deviations (p,)."""
        return np.sqrt(np.diag(self.covariance) + (0.0 if self.hidden is None else self.hidden))

    @cached_property
    def covariance_root(self) -> FloatArray:
        """``L`` (p, k) with ``L L'`` the covariance of the parameters that have one; it may lack rank."""
        known = np.isfinite(np.diag(self.covariance))
        values, vectors = np.linalg.eigh(self.covariance[np.ix_(known, known)])
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))

    @cached_property
    def bank(self) -> FilterBank:
        """The filters that recordings are evaluated through."""
        return self.filters or filter_bank(self.machine.rate_hz, self.bandwidth_hz)

    @cached_property
    def corrections(self) -> Corrections:
        """Corrected linkages and positions, of the machine with channels at its joints."""
        return corrections_from_json(at_joints(self.machine, ())[0], self.steps)

    @property
    def arm(self) -> Machine:
        """The machine with channels at its joints and corrected linkages."""
        return self.corrections.machine

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""
        return tuple(joint.name for joint in self.machine.joints)

    @cached_property
    def parameters(self) -> Parameters:
        """Names and places of drive and base parameters in :attr:`theta`."""
        return Parameters(self.joints, drive_names(self.arm), self.base)

    @cached_property
    def parameter_units(self) -> tuple[str, ...]:
        """Units of all parameters (p,)."""
        units = [
            drive_units(joint)[name]
            for joint, names in zip(self.arm.joints, self.parameters.drive, strict=True)
            for name in names
        ]
        units += self.base.units
        for term in self.terms:
            if isinstance(term.content, Effect):
                units += [parameter.unit for parameter in term.content.parameters]
            else:
                unit = self.effort_units[term.joint or 0]
                units += [unit] * term.content.functions
        return tuple(units)

    @property
    def effort_units(self) -> tuple[str, ...]:
        """Units of the drives' efforts: N of a piston, the joint's own where there is none."""
        return tuple(map(effort_unit, self.arm.joints))

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Units of the joints' efforts, N m or N."""
        return tuple(joint.effort_unit for joint in self.machine.joints)

    @property
    def limits(self) -> FloatArray:
        """Lowest and highest positions (2, n) of the joints, rad or m."""
        return np.array([joint.limits.position for joint in self.machine.joints], dtype=float).T

    @property
    def usual_oil(self) -> float:
        """The middle of the oil's temperatures that were recorded, K; 0 where nobody measured it."""
        return 0.0 if self.temperature is None else sum(self.temperature) / 2

    def drive_values(self, joint: int) -> dict[str, float]:
        """Return the parameters of a joint's drive by name."""
        values = self.theta[self.parameters.drive_slice(joint)].tolist()
        return dict(zip(self.parameters.drive[joint], values, strict=True))

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all parameters (p,): ``joint1.f_c``, a base parameter's expression, ``joint2.stribeck.f``."""
        return (*self.parameters.names, *(name for term in self.terms for name in term.names(self.joints)))

    @cached_property
    def term_slices(self) -> tuple[slice, ...]:
        """Places of every term's parameters in :attr:`theta`."""
        widths = [term.width for term in self.terms]
        return tuple(slice(*ends) for ends in pairwise(accumulate(widths, initial=len(self.parameters))))

    @cached_property
    def delays(self) -> tuple[dict[str, float], frozenset[str]]:
        """Joint name to s by which its effort is late, and whose samples were passed on late."""
        return delays(self.machine, self.terms)

    def place(self, term: Term) -> str:
        """Return a term's place: its joint, or the machine."""
        return "the machine" if term.joint is None else self.joints[term.joint]

    def rest(self, lost: Collection[int]) -> ArmModel | None:
        """Return the fit without some of the terms; None where there is none."""
        kept = [term.label for number, term in enumerate(self.terms) if number not in lost]
        return next((own for own in self.rests if [term.label for term in own.terms] == kept), None)


def over_time(term: Term) -> bool:
    """Return whether a term depends on the motion before (or its sampling): a history, a derivative."""
    if isinstance(term.content, Law):
        return any(signal in _MEMORY for signal, _ in term.content.signals)
    return term.content.over_time


def of_sensors(term: Term) -> bool:
    """Return whether a term acts on a reading, not as a force of the machine."""
    return isinstance(term.content, Effect) and term.content.level == "measurement"


def phase_unknown(term: Term, number: int) -> bool:
    """Return whether a term's phase belongs to single recordings, and this is none."""
    phases = [key for key in term.shape if key.startswith("phase_")]
    return bool(phases) and f"phase_{number}" not in phases
