"""What ``GET /machines/{name}/monitor`` gives."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

from server.platform.http.bodies import Message


class MovedNumber(BaseModel):
    """A number of a valve that has moved: ``edge``, ``gain`` or ``delay`` of a direction, by ``value`` in ``unit``."""

    name: str
    value: float
    std: float
    unit: str


class MonitoredJoint(BaseModel):
    """One joint's residual and its cumulative sums.

    ``residual`` is the root mean square of measured minus predicted effort (of valves: speed of the rod) over the last
    block, null while the joint rests. ``cusum`` is the largest of its sums, in standard deviations; a drift begins at
    ``threshold`` and ends at half of it. ``statistic`` says of what: ``offset``, ``direction`` (friction), ``level``
    (load or gain); of valves as in ``moved``, which says what a drift has moved as far as the blocks since then tell.
    ``false_alarms_per_year`` is of this joint, if it moved all year. ``learnt`` is 0 to 1.
    """

    joint: str
    residual: float | None
    unit: str
    cusum: float
    statistic: str
    threshold: float
    false_alarms_per_year: float
    learnt: float
    moved: list[MovedNumber] = []


class Payload(BaseModel):
    """Mass at the tip beyond that of the calibration's recordings, kg, of the last ten seconds of motion."""

    mass: float
    std: float


class OverloadNow(BaseModel):
    """An overload that has not ended: where, measured minus predicted effort there, and that over its band."""

    on: bool
    time: float
    joint: str
    residual: float
    unit: str
    score: float
    threshold: float


class OverloadJoint(BaseModel):
    """How near a joint came to an overload within the last second.

    ``residual`` is measured minus predicted effort at its nearest moment; ``share`` is of the threshold, above 1 it is
    an overload.
    """

    joint: str
    residual: float
    unit: str
    share: float


class Monitored(BaseModel):
    """What is followed against one calibration; ``reason`` says why it is off, ``delay_s`` how late the residual is."""

    state: Literal["off", "learning", "watching", "drift"]
    calibration: str | None = None
    since: str | None = None
    reason: str | None = None
    reason_message: Message | None = None
    joints: list[MonitoredJoint] = []
    time: float | None = None
    delay_s: float | None = None


class MonitorResource(Monitored):
    """The monitor of a machine, against the calibration of its mechanics, and of its ``valves``.

    ``overload_delay_s`` says how late an overload is judged, null where overloads are not watched: the calibration's
    model does not say what is usual. ``overload_joints`` leaves out joints that could not be judged. ``payload`` is
    null where too little moved.
    """

    payload: Payload | None = None
    overload: OverloadNow | None = None
    overload_joints: list[OverloadJoint] = []
    overload_delay_s: float | None = None
    valves: Monitored
