"""Orders to a monitor process, and its reports of overloads. Free of numerical imports: HTTP shows them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

#: Blocks from which a statistic's usual values are learnt.
LEARN = 120


@dataclass(frozen=True)
class Rules:
    """Settings by which the monitor decides.

    Attributes
    ----------
    learn : blocks to learn from
    block_s : s of machine time of a block
    false_alarms_per_year : drifts that are none, of the whole machine, if it moved all year
    false_overloads_per_hour : overloads that are none, of the whole machine
    """

    learn: int = LEARN
    block_s: float = 2.0
    false_alarms_per_year: float = 1.0
    false_overloads_per_hour: float = 1.0 / 24.0


@dataclass(frozen=True)
class Order:
    """Input of the process that watches one machine against a calibration.

    Attributes
    ----------
    of : what the active calibration is of: ``identification`` or ``valves``
    model : its ``model.json``, or its ``valve.json``
    machine : machine file that the acquisition runs by
    ring_name : its ring buffer
    memory : file in which what was learnt is kept over restarts
    rules : how to decide
    """

    of: str
    model: Path
    machine: Path
    ring_name: str
    memory: Path
    rules: Rules

    def to_json(self) -> str:
        """Write the text of an order file."""
        return json.dumps({**{k: str(v) for k, v in vars(self).items() if k != "rules"}, "rules": asdict(self.rules)})

    @classmethod
    def from_json(cls, text: str) -> Order:
        """Invert :meth:`to_json`."""
        content = json.loads(text)
        return cls(
            content["of"],
            Path(content["model"]),
            Path(content["machine"]),
            content["ring_name"],
            Path(content["memory"]),
            Rules(**content["rules"]),
        )


@dataclass(frozen=True)
class OverloadNow:
    """An overload that has not ended: where, measured minus predicted effort there, and that over its band."""

    on: bool  # False: it has ended, and only the time means something
    time: float  # s of machine time of the newest sample then
    joint: str
    residual: float
    unit: str
    score: float  # residual over its band
    threshold: float  # that the score exceeds


@dataclass(frozen=True)
class OverloadJoint:
    """How near a joint came to an overload within the last second.

    ``residual`` is measured minus predicted effort at its nearest moment; ``share`` is of the threshold, above 1 it is
    an overload.
    """

    joint: str
    residual: float
    unit: str
    share: float
