"""The mechanics of a machine file: joints, their limits, and what drives them."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from daq.arrays import FloatArray
from daq.errors import BadValueError
from daq.machine.buses import FileModel, Name
from daq.machine.linkages import FourBar, Linkage, Pins, ThreePin, reduced
from daq.machine.valves import Valve
from daq.messages import Sentence

Positive = Annotated[float, Field(gt=0)]
Interval = tuple[float, float]
#: A chain whose closing cosine is within this of 1 counts as stretched: an angle of 0.6 degrees, where the lever arm
#: is some hundred times its usual size.
_STRETCHED = 5e-5
#: Where a joint has it.
_LINKAGE = ("cylinder", "linkage")
#: ``standard`` (distal): frame i at the far end of link i, joint i about z of frame i - 1.
#: ``modified`` (proximal, Craig; Khalil and Kleinfinger): frame i at joint i, which is about z of frame i.
Convention = Literal["standard", "modified"]


def ordered(interval: Interval, what: str) -> Interval:
    """Return the interval; ValueError unless it goes from low to high."""
    if interval[0] >= interval[1]:
        raise BadValueError("daq.must_go_low_high", what=what, interval=interval[0], interval_2=interval[1])
    return interval


def unique(names: list[str], what: str, where: str) -> None:
    """Refuse names of parts, which are in the list ``where``, with a ValueError if one is there twice."""
    for number, name in enumerate(names):
        if name in names[:number]:
            at = (where, number)
            raise BadValueError("daq.name_repeated", at=at, what=what, name=name, name_2=names.count(name))


class DenavitHartenberg(FileModel):
    """A Denavit-Hartenberg row; the joint variable adds to ``theta``, or to ``d`` of a prismatic joint.

    ``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` in the standard convention, ``Rx(alpha) Tx(a) Rz(theta) Tz(d)`` in the modified
    one, where ``a`` and ``alpha`` stand before the joint (``a_{i-1}``, ``alpha_{i-1}``).
    """

    a: float  # m
    alpha: float  # rad
    d: float  # m
    theta: float  # rad


class Limits(FileModel):
    """What the joint may do: position (rad or m), speed and acceleration."""

    position: Interval
    velocity: Positive
    acceleration: Positive

    @field_validator("position")
    @classmethod
    def _position(cls, value: Interval) -> Interval:
        return ordered(value, "position")


class Cylinder(FileModel):
    """A hydraulic cylinder and the linkage between its rod and the joint."""

    bore: Positive  # m
    rod: Annotated[float, Field(ge=0)]  # m; 0 never occurs on a real single-rod cylinder but is a plunger
    stroke: Positive  # m
    damping: Annotated[float, Field(ge=0)] = 0.0  # N s/m, known; 0: then it is part of f_v
    moving_mass: Annotated[float, Field(gt=0)] | None = None  # kg if known, else identified
    vented: Literal["head", "rod"] | None = None  # this chamber is open to the air: gauge pressure 0, no channel
    valve: Valve | None = None  # what moves it, where commands are recorded
    linkage: Linkage

    @model_validator(mode="after")
    def _rod_fits(self) -> Cylinder:
        if self.rod >= self.bore:
            raise BadValueError("daq.rod_must_thinner_bore", at=("rod",), rod=self.rod, bore=self.bore)
        return self

    @property
    def head_area(self) -> float:
        """A1 in m^2."""
        return float(np.pi * self.bore**2 / 4)

    @property
    def rod_area(self) -> float:
        """A2, the annulus on the rod side, in m^2."""
        return float(np.pi * (self.bore**2 - self.rod**2) / 4)


class Coupling(FileModel):
    """Another joint that a motor turns with."""

    joint: str
    ratio: float  # rad of the motor per rad (m) of that joint


class Drive(FileModel):
    """A motor and its gear instead of a cylinder.

    The motor stands at ``ratio q_own + sum ratio_k q_k`` (``coupled``), and its effort acts on every joint it turns
    with by the same ratio: ``tau = R' tau_motor`` where ``q_motor = R q``.
    """

    ratio: float = 1.0  # rad of the motor per rad (m) of its own joint; negative: it turns the other way
    coupled: tuple[Coupling, ...] = ()
    offset: bool = False  # the measured effort's zero is a parameter
    #: Where the joint's effort is measured: before the motor's inertia and friction (a current, say), or behind the
    #: gear (a torque sensor in the joint), which the motor's inertia does not pass.
    effort: Literal["motor_side", "link_side"] = "motor_side"

    @model_validator(mode="after")
    def _turns(self) -> Drive:
        if self.ratio == 0:
            raise BadValueError("daq.ratio_must_not", at=("ratio",))
        for index, coupling in enumerate(self.coupled):
            if coupling.ratio == 0:
                raise BadValueError("daq.coupled_ratio_must_not", at=("coupled", index, "ratio"), index=index)
        unique([coupling.joint for coupling in self.coupled], "coupled joint", "coupled")
        return self


class Joint(FileModel):
    """One joint, from base to tip."""

    name: Name
    type: Literal["revolute", "prismatic"] = "revolute"
    dh: DenavitHartenberg
    limits: Limits
    cylinder: Cylinder | None = None
    drive: Drive | None = None  # what a joint without a cylinder may say of its motor

    @property
    def effort_unit(self) -> str:
        """``N m`` for a revolute joint, ``N`` for a prismatic one."""
        return "N m" if self.type == "revolute" else "N"

    @model_validator(mode="after")
    def _one_drive(self) -> Joint:
        if self.cylinder is not None and self.drive is not None:
            raise BadValueError("daq.both_cylinder_drive")
        return self

    @model_validator(mode="after")
    def _angles_are_the_tables(self) -> Joint:
        """Take the table's own frames for pins' coordinates without an ``angle``."""
        if self.cylinder is None or not isinstance(self.cylinder.linkage, Pins | FourBar):
            return self
        linkage = self.cylinder.linkage
        if self.type != "revolute":
            raise BadValueError("daq.cylinder_linkage_type_needs", at=_LINKAGE, type=linkage.type)
        if linkage.angle is None:
            linkage = linkage.model_copy(update={"angle": self.dh.theta})
            cylinder = self.cylinder.model_copy(update={"linkage": linkage})
            object.__setattr__(self, "cylinder", cylinder)  # frozen: still being made
        return self

    @model_validator(mode="after")
    def _linkage_closes(self) -> Joint:
        if self.cylinder is None:
            return self
        linkage, stroke = reduced(self.cylinder.linkage), self.cylinder.stroke
        q = np.linspace(*self.limits.position, 201)
        if isinstance(linkage, FourBar):
            _chain_closes(linkage, q)
        x = linkage.piston_position(q)
        if isinstance(linkage, ThreePin):
            shortest, longest = abs(linkage.a - linkage.b), linkage.a + linkage.b
            what = "a, b, retracted" if self.cylinder.linkage is linkage else Sentence("daq.four_points_retracted")
            if linkage.retracted >= longest or linkage.retracted + stroke <= shortest:
                raise BadValueError(
                    "daq.cylinder_linkage_cannot_close",
                    at=_LINKAGE,
                    shortest=shortest,
                    longest=longest,
                    retracted=linkage.retracted,
                    retracted_2=linkage.retracted + stroke,
                    what=what,
                )
        if x.max() <= 0 or x.min() >= stroke:
            raise BadValueError(
                "daq.cylinder_linkage_cannot_close_within",
                at=_LINKAGE,
                value=x.min(),
                value_2=x.max(),
                stroke=stroke,
                zero=_ZEROS[self.cylinder.linkage.type],
            )
        if np.any(np.diff(x) >= 0) and np.any(np.diff(x) <= 0):
            turn = _TURNS[self.cylinder.linkage.type]
            raise BadValueError("daq.cylinder_linkage_passes_dead", at=_LINKAGE, turn=turn)
        tolerance = 1e-6 + 1e-3 * stroke
        if x.min() < -tolerance or x.max() > stroke + tolerance:
            at, low, high = ("cylinder", "stroke"), x.min(), x.max()
            raise BadValueError("daq.cylinder_stroke_exceeded_limits", at=at, stroke=stroke, value=low, value_2=high)
        return self


#: What of each linkage decides where the piston stands, and where its dead centres are.
_ZEROS = {
    "three_pin": "retracted or offset",
    "pins": "retracted, the four points or angle",
    "four_bar": "retracted, the points, side or angle",
    "rack": "zero",
    "direct": "limits.position",
    "polynomial": "the first coefficient",
}
_TURNS = {
    "three_pin": "offset",
    "pins": "the points or angle",
    "four_bar": "the points, side or angle",
    "polynomial": "the coefficients",
    "rack": "radius",
    "direct": "limits.position",
}


def _chain_closes(linkage: FourBar, q: FloatArray) -> None:
    """Refuse a four-bar chain that opens, or is stretched, somewhere in ``q``.

    Stretched, coupler and rocker are in line: the link is then held whatever the cylinder does, ``r`` is infinite.
    """
    cosine = linkage.closing_cosine(q)
    if np.all(np.abs(cosine) < 1.0 - _STRETCHED):
        return
    worst = int(np.argmax(np.abs(cosine)))
    reach = float(np.linalg.norm(linkage.link_pin(q)[0][worst]))
    least, most = abs(linkage.coupler_arm - linkage.coupler), linkage.coupler_arm + linkage.coupler
    raise BadValueError(
        "daq.cylinder_linkage_cannot_close_rad", at=_LINKAGE, angle=q[worst], reach=reach, least=least, most=most
    )
