"""One moment of an arm in nodes: what goes into a model's expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

#: A number or a node.
Value = Any


@dataclass(frozen=True)
class State:
    """A moment: position, speed, acceleration of every joint (n nodes or numbers each), time since the beginning."""

    q: Sequence[Value]
    qd: Sequence[Value]
    qdd: Sequence[Value]
    t: Value
