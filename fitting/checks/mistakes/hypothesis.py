"""A mistake that may have been made, how a trial takes it back, and which wrong unit a gain looks like."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from daq.machine.machine_file import Channel, Machine
from fitting.checks.mistakes.physical import Trial

#: Per joint the weights of the signals that make its effort, where they are not the machine file's.
Targets: TypeAlias = Mapping[int, Mapping[str, float]]
#: Takes a mistake back.
Build: TypeAlias = Callable[[Trial, Targets], tuple[Trial, Targets]]
#: Factor by which the misfit of a joint has to fall for an accusation.
CLEAR = 2.2
#: Units of a quantity, by its SI unit, with their size in SI.
_UNITS: dict[str, dict[str, float]] = {
    "Pa": {"bar": 1e5, "kPa": 1e3, "psi": 6894.757, "MPa": 1e6, "hPa (mbar)": 1e2, "Pa": 1.0},
    "rad": {"rad": 1.0, "deg": 1 / (180.0 / np.pi), "mrad": 1e-3, "turn": 2 * np.pi, "grad": np.pi / 200},
    "m": {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "um": 1e-6},
    "N": {"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.448222},
    "N m": {"N m": 1.0, "kN m": 1e3, "N mm": 1e-3, "kgf m": 9.80665, "lbf ft": 1.355818, "N cm": 1e-2},
}
#: Units that people seldom use: a common one that fits nearly as well is named instead.
RARE = ("grad", "turn", "mrad", "um", "hPa (mbar)", "inch", "N cm")


def gains(machine: Machine, channel: Channel) -> dict[float, str]:
    """Return the factors for a channel's SI values, by the unit they may have been in instead of the declared one."""
    declared, sizes = machine.conversion(channel).factor, _UNITS.get(machine.si_unit(channel), {})
    return {size / declared: unit for unit, size in sizes.items() if abs(size / declared - 1) > 0.05}


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that may have been made.

    Attributes
    ----------
    code, text, cure : as in a finding, with ``{joint}`` and ``{channel}`` left open
    joints : numbers of the joints it is about
    build : gives the changed trial and targets
    channels : quantities of those joints' channels that it is about
    names : of the channels, where it is not about all of those
    key : place in the machine file that would be wrong, if it is one
    factor : number that it is about
    price : simplicity: of two that explain alike, the one with the lower price is named
    recording : number of the recording that it is about
    least : factor by which a joint's misfit has to fall
    every : it is about all joints
    exact : it puts channels or roles right and changes no number: no effect resembles it, so that it is tried however
        well the efforts are explained
    slip : a length's sign, decimal point or unit, or an axis that is turned: no effect is as large, and every joint
        that carries the link feels it. It is tried where most joints are explained worse than they can be, however
        little that is
    """

    code: str
    text: str
    cure: str
    joints: tuple[int, ...]
    build: Build = field(repr=False)
    channels: tuple[str, ...] = ()
    names: tuple[str, ...] = field(default=(), kw_only=True)
    key: tuple[str | int, ...] = ()
    factor: float | None = None
    price: float = 1.0
    recording: int | None = None
    least: float = CLEAR
    every: bool = False
    exact: bool = False
    slip: bool = False
