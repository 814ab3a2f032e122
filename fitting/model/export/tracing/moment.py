"""One moment of an arm in nodes: what goes into a model's expressions, and what comes out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fitting.model.export.tracing.graph import Node

#: A number or a node.
Value = Any


@dataclass(frozen=True)
class State:
    """A moment: position, speed, acceleration of every joint (n nodes or numbers each), time since the beginning."""

    q: Sequence[Value]
    qd: Sequence[Value]
    qdd: Sequence[Value]
    t: Value


@dataclass(frozen=True)
class Efforts:
    """What a model says of a moment, per joint.

    Attributes
    ----------
    joint, drive : effort of the joint (N m, N) and of its drive (N at a piston)
    head, rod : chamber pressures, Pa; None where there is no cylinder or no pressure was measured
    """

    joint: tuple[Node, ...]
    drive: tuple[Node, ...]
    head: tuple[Node | None, ...]
    rod: tuple[Node | None, ...]
