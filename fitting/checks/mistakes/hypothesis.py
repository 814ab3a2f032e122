"""A mistake that may have been made, and how a trial takes it back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from fitting.checks.mistakes.physical import Trial

#: Per joint the weights of the signals that make its effort, where they are not the machine file's.
Targets: TypeAlias = Mapping[int, Mapping[str, float]]
#: Takes a mistake back.
Build: TypeAlias = Callable[[Trial, Targets], tuple[Trial, Targets]]
#: Factor by which the misfit of a joint has to fall for an accusation.
CLEAR = 2.2


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that may have been made.

    Attributes
    ----------
    code, text, cure : as in a finding, with ``{joint}`` and ``{channel}`` left open
    joints : numbers of the joints it is about
    channels : quantities of those joints' channels that it is about
    key : place in the machine file that would be wrong, if it is one
    build : gives the changed trial and targets
    factor : number that it stands for
    price : simplicity: of two that explain alike, the one with the lower price is said
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
    key: tuple[str | int, ...] = ()
    factor: float | None = None
    price: float = 1.0
    recording: int | None = None
    least: float = CLEAR
    every: bool = False
    exact: bool = False
    slip: bool = False
