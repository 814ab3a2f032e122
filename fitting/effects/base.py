"""Interface of an effect: the seam `hilfit.effects`.

An effect is one physical phenomenon that the base model lacks. It describes itself (texts for people), and gives
regressor columns: what one unit of each of its parameters adds to the drive effort (N at the piston, positive extends),
given what is known about a joint's motion. Columns are built from the motion and from the *model's* force, never from
the measured force: a regressor that contains the measurement noise of the very thing it explains fits that noise.

Hooks and why they are there:

``shapes``
    Non-linear shape parameters are scanned on a grid; each shape is one candidate and pays for the size of the grid.
``columns``
    The linear part; one column per entry of ``parameters``.
``plausible``
    A fit that needs a negative friction coefficient is no explanation, however small its residual.
``applies``
    An effect of chambers needs pressures, one of a cylinder a cylinder.
``discrete_shapes``, ``shape_units``
    What of a shape is a choice, and in which unit the rest is.
``body_columns``
    Where an effect is a change of the rigid body it names that, and the model's exports write that out.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np
import scipy

from daq.machine.machine_file import Cylinder, Machine
from fitting.arm.base_parameters import BaseParameters, base_regressor
from fitting.arm.expected import expected_power, expected_sign
from fitting.arm.linkage import cylinder_of
from fitting.arrays import FloatArray
from fitting.signals.corrections import Corrections
from fitting.signals.filters import FilterBank
from fitting.signals.motion_frequency import quiet_motion
from fitting.signals.preparation import PositionNoise, Segment

Shape = Mapping[str, float]
Level = Literal["cylinder", "joint", "measurement"]


@dataclass(frozen=True)
class Parameter:
    """One linear parameter of an effect: name, unit, and the interval a plausible value lies in."""

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf


@dataclass(frozen=True)
class Ranges:
    """Ranges of a joint's signals over all fitted recordings, so that a shape means the same in each of them."""

    x: tuple[float, float]
    v: float
    force: float
    time: tuple[float, float]

    @property
    def middle(self) -> float:
        """Middle of the stroke that was used, m."""
        return 0.5 * (self.x[0] + self.x[1])

    @property
    def span(self) -> float:
        """Stroke that was used, m."""
        return self.x[1] - self.x[0]


@dataclass(frozen=True)
class DriveView:
    """Data that an effect may use: one joint in one segment, ``N`` samples at full rate, SI.

    Attributes
    ----------
    machine, joint : the machine and the joint's number
    segment : the prepared segment
    bank : the filters (for derivatives)
    noise : position noise of every joint
    forces : (N, n) the model's drive efforts ``F^`` of all joints
    loads : (N, n) the model's load forces ``F_l`` (rigid body only) at the piston
    rod_pressures : gives the (N, n) expected rod pressures in Pa, free of measurement noise; NaN without sensors
    ranges : ranges per joint
    clock : (N,) s since the recording's first sample
    base, base_values : the base parameters and their present estimate
    loaded_recordings : numbers of the fitted recordings with a load
    cache : scratch for columns that several shapes share
    shared : scratch that all joints of the segment share
    """

    machine: Machine
    joint: int
    segment: Segment
    bank: FilterBank
    noise: tuple[PositionNoise, ...]
    forces: FloatArray
    loads: FloatArray
    rod_pressures: Callable[[], FloatArray]
    ranges: tuple[Ranges, ...]
    clock: FloatArray
    base: BaseParameters
    base_values: FloatArray
    loaded_recordings: tuple[int, ...]
    cache: dict[str, FloatArray] = field(default_factory=dict, repr=False, compare=False)
    shared: dict[str, FloatArray] = field(default_factory=dict, repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.segment)

    @property
    def x(self) -> FloatArray:
        """Position of the driving element, m (or the joint's unit)."""
        return self.segment.x[:, self.joint]

    @property
    def v(self) -> FloatArray:
        """Its speed."""
        return self.segment.v[:, self.joint]

    @property
    def a(self) -> FloatArray:
        """Its acceleration."""
        return self.segment.a[:, self.joint]

    @property
    def q(self) -> FloatArray:
        """Joint position, rad or m."""
        return self.segment.q[:, self.joint]

    @property
    def r(self) -> FloatArray:
        """Lever arm dx/dq."""
        return self.segment.r[:, self.joint]

    @cached_property
    def s(self) -> FloatArray:
        """Expected sign of the speed, given its noise."""
        return expected_sign(self.v, self.noise[self.joint].sign)

    def power(self, exponent: float) -> FloatArray:
        """Compute expected ``|v|^exponent sgn(v)``, given the speed's noise."""
        return expected_power(self.v, self.noise[self.joint].sign, exponent)

    @property
    def force(self) -> FloatArray:
        """``F^``, the model's own drive effort."""
        return self.forces[:, self.joint]

    @property
    def load(self) -> FloatArray:
        """``F_l``, the model's load force at the piston."""
        return self.loads[:, self.joint]

    def bending_force(self, friction: bool) -> FloatArray:
        """Compute what bends a structure or takes up play between position sensors, N at the piston.

        With ``friction`` what the chambers give, else what the arm asks of the piston.
        """
        return self.force if friction else self.load

    @property
    def quiet_torque(self) -> FloatArray:
        """The model's load torque, N m (N), for further derivatives: see :mod:`fitting.signals.motion_frequency`."""
        if "quiet_torques" not in self.shared:
            motion = quiet_motion(self.segment, self.noise, self.bank)
            self.shared["quiet_torques"] = base_regressor(self.machine, self.base, *motion) @ self.base_values
        return self.shared["quiet_torques"][:, self.joint]

    @property
    def p1(self) -> FloatArray:
        """Head pressure that the model's force and the expected rod pressure make, Pa."""
        return self.head_pressure_of(self.joint)

    @property
    def p2(self) -> FloatArray:
        """Expected rod pressure, Pa: by motion and model force, without its own noise."""
        return self.rod_pressure_of(self.joint)

    def head_pressure_of(self, joint: int) -> FloatArray:
        """Return :attr:`p1` of any joint that has a cylinder with pressures."""
        cylinder = cylinder_of(self.machine.joints[joint])
        return (self.forces[:, joint] + self.rod_pressure_of(joint) * cylinder.rod_area) / cylinder.head_area

    def rod_pressure_of(self, joint: int) -> FloatArray:
        """Return :attr:`p2` of any joint that has a cylinder with pressures."""
        if "rod_pressures" not in self.shared:
            self.shared["rod_pressures"] = self.rod_pressures()
        return self.shared["rod_pressures"][:, joint]

    @property
    def cylinder(self) -> Cylinder:
        """The joint's cylinder."""
        return cylinder_of(self.machine.joints[self.joint])

    @property
    def range(self) -> Ranges:
        """Ranges of this joint's signals over all fitted recordings."""
        return self.ranges[self.joint]

    def body_change(self, position: FloatArray) -> FloatArray:
        """Compute the change (N, n) of all drive efforts when this link moves by ``position`` (N,), first order.

        Along the whole trajectory: speed and acceleration change with the position.
        """
        rates = self.bank.rate(position)
        moved = np.stack([position, rates, self.bank.rate(rates)])
        return np.asarray(np.einsum("kn,knj->nj", moved, self._body_slopes))

    @property
    def _body_slopes(self) -> FloatArray:
        """Drive efforts per position, speed and acceleration of this joint, (3, N, n)."""
        if "body_slopes" not in self.cache:
            slopes = []
            # Of a smooth function: errors of 1e-6 of the second derivative, roundings of 1e-10; the last is linear.
            for k, step in enumerate((1e-6, 1e-6, 1.0)):
                motion = [values.copy() for values in (self.segment.q, self.segment.qd, self.segment.qdd)]
                motion[k][:, self.joint] += step
                speeds = [own.sign for own in self.noise]
                there = base_regressor(self.machine, self.base, *motion, speed_noise=speeds) @ self.base_values
                slopes.append((there / self.segment.r - self.loads) / step)
            self.cache["body_slopes"] = np.array(slopes)
        return self.cache["body_slopes"]


class Parity(Enum):
    """Dependence of an effect on the sense of motion."""

    ODD = "odd in v"
    EVEN = "even in v"
    NEITHER = "neither even nor odd in v"
    OTHER = "follows something else"


@dataclass(frozen=True)
class BodyColumn:
    """A column of an effect that is a change of the rigid body.

    Attributes
    ----------
    gravity : (3,) field in the base frame, m/s^2
    links : (n, 10) standard parameters per unit of the column; None: the fitted links, at rest
    since : time from which on it acts, s; None: always
    """

    gravity: FloatArray
    links: FloatArray | None = None
    since: float | None = None


class FoundBy(Enum):
    """Where an effect is looked for."""

    COLUMNS = "its columns in the residual"
    LINES = "spectral lines of the residual"


class Effect(ABC):
    """Base class of effects; see the module's text for what each hook is for.

    Parameters
    ----------
    view : of all hooks: motion, force and ranges of the joint in one segment of a recording, (N,) each, SI
    shape : one of :meth:`shapes` (:meth:`gap_shapes`): what columns depend on other than linearly, by name
    machine, joint : what the machine file states, and the number of the joint, from 0 at the base (of signals its name)
    values, stds : (k,) of ``parameters``, in their units, and standard deviations
    corrections : of a session's positions, which get one more
    """

    id: ClassVar[str]
    title: ClassVar[str]
    level: ClassVar[Level]
    #: Signal that a residual is best drawn against: one of the report's variables; ``other.`` represents a neighbour.
    variable: ClassVar[str]
    #: False where the columns depend on the measured motion only, not on the model's present parameters.
    uses_model: ClassVar[bool] = True
    equation: ClassVar[str]
    #: How it depends on the sense of motion; conformance checks it against the columns.
    parity: ClassVar[Parity]
    #: The same for people, with what else is typical of it.
    dependence: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    confounders: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str]
    #: False where the experiment takes a hand or an instrument: a design of motions cannot make it.
    by_motion: ClassVar[bool] = True
    #: Which part of the machine, or which line of its file, a person should look at when this was found.
    look_at: ClassVar[str] = ""
    source: ClassVar[str]
    #: True where the effect is one of oil and chambers; friction is there in any drive.
    needs_cylinder: ClassVar[bool] = False
    #: True where both chambers of the cylinder have to be measured.
    needs_pressures: ClassVar[bool] = False
    #: True where one effect acts on the whole machine (``columns`` then gives all joints at once).
    machine_wide: ClassVar[bool] = False
    #: True where an effect of one joint changes the efforts of all (``columns`` gives all joints at once).
    spreads: ClassVar[bool] = False
    #: True where a column at one moment depends on samples before or after it: a history, a derivative, a filter.
    over_time: ClassVar[bool] = False
    #: True where the formula is a short series for any smooth law of its variables, not a law of physics: nature may
    #: then differ from it by more.
    series: ClassVar[bool] = False
    #: Where it is looked for.
    found_by: ClassVar[FoundBy] = FoundBy.COLUMNS
    #: Entries of its shapes that are choices, not numbers to be searched between.
    discrete_shapes: ClassVar[frozenset[str]] = frozenset()
    #: Units of entries of its shapes that are numbers; without one an entry is a number, or a choice if discrete.
    shape_units: ClassVar[Mapping[str, str]] = {}
    #: True where the joint's effort itself is moved in time; the column is only the beginning of what that does.
    delays_effort: ClassVar[bool] = False
    #: True where what it does to positions is between the sensors: both are right, each for its own side.
    between_sensors: ClassVar[bool] = False
    #: How slow that is: what it is late by, s, and the square of its mode's period over two pi, s^2.
    slow: ClassVar[tuple[float, float]] = (0.01, 1e-3)
    #: Effects that are this one with some parameters zero: where they explain the same, they are the simpler name.
    includes: ClassVar[tuple[str, ...]] = ()

    def applies(self, machine: Machine, joint: int) -> bool:
        """Return whether the joint can have this effect, and its channels show it."""
        if machine.joints[joint].cylinder is None:
            return not (self.needs_cylinder or self.needs_pressures)
        return has_pressures(machine, joint) or not self.needs_pressures

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return the grid of shape parameters; one empty shape if none. ``view`` gives scales (its ranges)."""
        return ({},)

    def variants(self, machine: Machine, joint: int) -> Sequence[tuple[int, ...]]:
        """Return the joints that ``other`` of its shapes may be, one candidate each; one empty tuple without it."""
        others = [(other,) for other in range(len(machine.joints)) if other != joint]
        return others if "other" in self.discrete_shapes else ((),)

    @abstractmethod
    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        """Compute columns, drive effort per unit of each parameter: (N, k), or (N, n, k) where it acts on all."""

    def body_columns(self, machine: Machine, shape: Shape) -> Sequence[BodyColumn] | None:
        """Return its columns as changes of the rigid body, for exports; None where they are none."""
        return None

    def references(self, view: DriveView, shape: Shape) -> Mapping[str, tuple[float, str]]:
        """Return values that the formula counts from outside its parameters: name to value and unit.

        Where the recordings or the machine file set them (a middle of the stroke that was used), coefficients of two
        identifications can be compared only beside them.
        """
        return {}

    def signal(self, shape: Shape) -> str:
        """Return the signal of its formula, in this shape, as :attr:`variable` names it."""
        return self.variable

    def overtone(self, shape: Shape) -> Shape | None:
        """Return the shape of nature's overtone to a periodic formula; None where not periodic."""
        return None

    def confined(self, shape: Shape) -> bool:
        """Return whether the effect, in this shape, acts in single recordings only: no other tests it."""
        return False

    def gap_shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return the shapes between two position sensors, where others are possible."""
        return self.shapes(view)

    def gap_units(self, shape: Shape) -> tuple[str, ...]:
        """Return the units of its parameters there, in a shape."""
        return tuple(parameter.unit for parameter in self.parameters)

    def gap_columns(self, view: DriveView, shape: Shape) -> FloatArray | None:
        """Compute what a unit adds to (piston position less x(joint position)), m, columns (N, k); None if nothing."""
        return None

    def gap_change(self, view: DriveView, shape: Shape, values: Sequence[float]) -> FloatArray | None:
        """Compute what these values add to that gap, m (N,), of any size; None if nothing."""
        columns = self.gap_columns(view, shape)
        return None if columns is None else np.asarray(columns @ np.asarray(values))

    def places(self, shape: Shape) -> Sequence[Shape]:
        """Return shapes among which only the efforts can choose: what gives way moves the piston, or only its sensor.

        Friction follows the piston's own speed.
        """
        return tuple({**shape, "sensor": sensor} for sensor in (0.0, 1.0)) if self.between_sensors else (shape,)

    def apply_to_signals(
        self, corrections: Corrections, joint: str, shape: Shape, values: Sequence[float]
    ) -> Corrections:
        """Take it out of positions when recordings are prepared again, where it was found between position sensors.

        What is between the sensors is not taken out: each sensor is of its own side then.
        """
        if self.between_sensors:
            return corrections.with_play(joint, "sensor" if shape.get("sensor") else "pin")
        raise NotImplementedError(f"{self.id} is no effect on positions")

    def plausible(self, values: Sequence[float], stds: Sequence[float]) -> bool:
        """Return whether what makes it this effect is there; values are inside their intervals."""
        return True

    def possible(self, values: Sequence[float], stds: Sequence[float]) -> float:
        """Compute the share, 0 to 1, of normal values about these with these deviations that is possible."""
        share = 1.0
        for p, value, std in zip(self.parameters, values, stds, strict=True):
            if std > 0:
                share *= float(scipy.special.ndtr((p.high - value) / std) - scipy.special.ndtr((p.low - value) / std))
        return share


def has_both_positions(machine: Machine, joint: int) -> bool:
    """Return whether piston and joint are measured independently, so kinematics is checked without dynamics."""
    name = machine.joints[joint].name
    both = all(machine.channel(quantity, name) is not None for quantity in ("joint_position", "piston_position"))
    return both and machine.joints[joint].cylinder is not None


#: Where a compliance or a play may sit: along the cylinder (mounts, rod) or about the joint, and whether what bends it
#: bears the friction of the seals.
SITES: tuple[Shape, ...] = tuple({"about": a, "friction": f} for a in (0.0, 1.0) for f in (0.0, 1.0))


def gap_lever(view: DriveView, shape: Shape) -> FloatArray:
    """Compute piston stroke (N,) per unit of what gives way at a site, and effort there per piston force."""
    return view.r if shape.get("about", 1.0) else np.ones(len(view))


def position_change(view: DriveView, error: FloatArray) -> FloatArray:
    """Compute the change (N,) of (piston position less x(joint position)) by a joint reading too large by ``error``."""
    linkage = view.cylinder.linkage
    return np.asarray(linkage.piston_position(view.q - error) - linkage.piston_position(view.q))


def signal_of(variable: str, shape: Shape) -> tuple[str, int | None]:
    """Return the signal that an effect's variable is, and the neighbour that has it."""
    return (variable[6:], int(shape["other"])) if variable.startswith("other.") else (variable, None)


def has_pressures(machine: Machine, joint: int) -> bool:
    """Return whether both chambers of the joint's cylinder are measured."""
    name = machine.joints[joint].name
    return all(machine.channel(quantity, name) is not None for quantity in ("head_pressure", "rod_pressure"))


def geometric(low: float, high: float, count: int) -> tuple[float, ...]:
    """Return ``count`` values from ``low`` to ``high`` with equal ratios."""
    return tuple(float(value) for value in np.geomspace(low, high, count))
