"""What an arm is taken to weigh and to rub before a motion is planned: from a report, from a drawing, or a guess.

Chamber pressures, and every effect that lives on forces, need parameters that are only known after an identification.
Where none was made yet, links are taken for rods of equal line density between their joints, and friction for a small
share of what the cylinder can push; the guess states it, because a pressure limit then rests on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.machine.machine_file import Joint, Machine
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arm.geometry import geometry_of
from fitting.arm.linkage import lever_arm, stroke_limits
from fitting.arrays import FloatArray
from fitting.regression.body_prior import Drawing, read_body_prior, read_expected
from fitting.regression.drive import drive_names
from fitting.regression.plausible_arm import rods, standard_of_bodies
from fitting.regression.prior import moving_mass

#: Supply pressure of mobile hydraulics where the machine file gives none, Pa.
USUAL_SUPPLY = 21.0e6
_HOLDING_SHARE = 0.35  # of the supply pressure: what the heaviest pose of a sensibly sized arm takes
_DENSITY = 20.0  # kg/m, where no cylinder states how strong the arm is
_SEAL_SHARE = 0.01  # Coulomb friction over supply pressure times bore area: seals of a cylinder in good order
_NOISE_SHARE = 0.1  # effort noise in the band over Coulomb friction
_EFFORT_SHARE = 0.02  # Coulomb friction over the largest holding effort of a joint that is driven directly


@dataclass(frozen=True)
class Guess:
    """Parameters to plan with.

    Attributes
    ----------
    base : base parameters (nb,)
    drive : per joint, the values of :func:`fitting.regression.drive.drive_names` in that order
    noise : shape (n,), standard deviation of the drive effort's noise in the identification band, N (or the joint's
        unit)
    statement : where it comes from, in a sentence
    measured : True where it comes from an identification of this machine
    """

    base: FloatArray
    drive: tuple[FloatArray, ...]
    noise: FloatArray
    statement: str
    measured: bool

    @property
    def theta(self) -> FloatArray:
        """All parameters of a regression: drive, then base."""
        return np.concatenate([*self.drive, self.base])


def worst_friction(machine: Machine, guess: Guess) -> FloatArray:
    """Compute each cylinder's largest force (n,) in N beside its load, at its joint's limits; 0 without a cylinder.

    Friction at top speed, the known damping included, the stiffness over the whole stroke, and the moving mass at top
    acceleration: all at once, because a limit is meant to hold.
    """
    worst = np.zeros(len(machine.joints))
    for j, (joint, names, values) in enumerate(zip(machine.joints, drive_names(machine), guess.drive, strict=True)):
        if joint.cylinder is None:
            continue
        own = dict(zip(names, np.abs(values), strict=True))
        r = float(np.abs(lever_arm(joint.cylinder.linkage, np.linspace(*stroke_limits(joint), 101))).max())
        v, a = r * joint.limits.velocity, r * joint.limits.acceleration
        mass = own.get("m", joint.cylinder.moving_mass or 0.0)
        worst[j] = own["f_c"] + (own["f_v"] + joint.cylinder.damping) * v + own["f_s"] * np.cbrt(v)
        worst[j] += own["K"] * joint.cylinder.stroke + mass * a
    return worst


def guess_from_file(path: Path, machine: Machine, base: BaseParameters) -> Guess:
    """Guess from an identification's ``report.json``, or a drawing (:mod:`fitting.regression.body_prior`).

    A drawing knows the links only; friction and noise are then guessed.

    Raises
    ------
    InputError
        One line naming file and key.
    """
    report, body = read_expected(path), read_body_prior(path, base)
    rough = default_guess(machine, base)
    drive, noise = list(rough.drive), rough.noise.copy()
    if isinstance(report, Drawing):
        statement = f"links as in {path}, friction and noise guessed from the drives' sizes"
        return Guess(body.mean, tuple(drive), noise, statement, measured=False)
    for j, (joint, names) in enumerate(zip(machine.joints, drive_names(machine), strict=True)):
        found = report.drive(joint.name)
        values = [None if name not in found.parameters else found.parameters[name].value for name in names]
        drive[j] = np.array([rough if v is None else v for v, rough in zip(values, drive[j], strict=True)])
        noise[j] = found.residual_std or noise[j]
    return Guess(body.mean, tuple(drive), noise, f"parameters and noise as identified in {path}", measured=True)


def default_guess(machine: Machine, base: BaseParameters, supply: float = USUAL_SUPPLY) -> Guess:
    """Guess from geometry and cylinder sizes alone; ``supply`` is the supply pressure in Pa."""
    geometry = geometry_of(machine)
    links = np.array([max(sum(np.linalg.norm(end - start) for start, end in own), 0.1) for own in geometry.stretches])
    per_density = base.from_standard(standard_of_bodies(rods(geometry) * links.sum()))
    pressure, effort = _holding(machine, base, per_density)
    most = float(pressure.max(initial=0.0))
    # An arm without gravity in its way is not weighed by its cylinders.
    density = _HOLDING_SHARE * supply / most if most > 1e-6 * supply / _DENSITY else _DENSITY
    drive, noise = [], np.zeros(len(machine.joints))
    for j, (joint, names) in enumerate(zip(machine.joints, drive_names(machine), strict=True)):
        values = _drive(joint, supply, density * float(effort[j]))
        drive.append(np.array([values[name] for name in names]))
        noise[j] = _NOISE_SHARE * values["f_c"]
    statement = (
        f"a guess: links as rods of {density:.0f} kg/m, friction and noise from the drives' sizes (give --parameters "
        "with the report.json of an earlier identification)"
    )
    return Guess(density * per_density, tuple(drive), noise, statement, measured=False)


def _holding(machine: Machine, base: BaseParameters, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the arm's largest holding pressure (n,) in Pa and joint effort (n,) over poses; 0 Pa of no cylinder."""
    limits = np.array([stroke_limits(joint) for joint in machine.joints])
    shares = np.random.default_rng(0).uniform(size=(400, len(limits)))
    q = limits[:, 0] + shares * (limits[:, 1] - limits[:, 0])
    tau = np.abs(base_regressor(machine, base, q, np.zeros_like(q), np.zeros_like(q)) @ values)
    pressure = np.zeros(len(limits))
    for j, joint in enumerate(machine.joints):
        if joint.cylinder is not None:
            force = tau[:, j] / np.abs(lever_arm(joint.cylinder.linkage, q[:, j]))
            pressure[j] = float(force.max()) / joint.cylinder.rod_area
    return pressure, tau.max(axis=0)


def _drive(joint: Joint, supply: float, effort: float) -> dict[str, float]:
    if joint.cylinder is None:
        coulomb = _EFFORT_SHARE * max(effort, 1.0)
        return {"J": 0.0, "f_c": coulomb, "f_v": coulomb / joint.limits.velocity, "f_0": 0.0}
    coulomb = _SEAL_SHARE * supply * joint.cylinder.head_area
    r = float(np.abs(lever_arm(joint.cylinder.linkage, np.linspace(*stroke_limits(joint), 101))).max())
    viscous = coulomb / (r * joint.limits.velocity)
    stiffness = coulomb / joint.cylinder.stroke  # as much over the stroke as friction: seals, hoses
    return {"m": moving_mass(joint.cylinder), "K": stiffness, "f_c": coulomb, "f_v": viscous, "f_s": 0.0}
