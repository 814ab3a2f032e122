"""When something counts as wrong: on and off delay, dead-band. Pure; time is an argument.

The words are those of ISA-18.2 (IEC 62682): an alarm comes on when its condition has held for the on-delay, and goes
when the condition has been gone for the off-delay. A condition on a measured value has a dead-band: it comes above one
limit and goes below a lower one, so that noise about the limit is one alarm and not a hundred.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

Severity = Literal["info", "warning", "critical"]


@dataclass(frozen=True)
class AlarmKind:
    """How alarms of one kind come and go.

    Attributes
    ----------
    on_delay_s, off_delay_s : s that the condition has to hold, or to be gone
    """

    on_delay_s: float = 0.0
    off_delay_s: float = 0.0


#: All kinds. Acquisition may take some seconds to come up and a restart of it is no news; a telegram that is lost is
#: none either. What another part has already thought about (a drift, a failed job) has no delay.
KINDS: dict[str, AlarmKind] = {
    "acquisition_down": AlarmKind(on_delay_s=15.0, off_delay_s=2.0),
    "channel_stale": AlarmKind(on_delay_s=3.0, off_delay_s=5.0),
    "disk_full": AlarmKind(on_delay_s=0.0, off_delay_s=10.0),
    "clock_jumped": AlarmKind(),
    "residual_drift": AlarmKind(),
    "valve_drift": AlarmKind(),
    "overload": AlarmKind(),
    "residual_grew": AlarmKind(),
    "recalibration_failed": AlarmKind(),
    "worker_silent": AlarmKind(),
    "store_damaged": AlarmKind(),
    "audit_cut": AlarmKind(),
    "backup_failed": AlarmKind(),
    "webhook_failed": AlarmKind(),
}


@dataclass(frozen=True)
class Timer:
    """A condition between its two delays.

    Attributes
    ----------
    on : whether it counts as wrong
    since : s, when the condition began to differ from ``on``; None while it agrees
    """

    on: bool = False
    since: float | None = None


def step(timer: Timer, kind: AlarmKind, condition: bool, now: float) -> Timer:
    """Step the timer by a look at the condition at ``now`` (s, a clock that never jumps)."""
    if condition == timer.on:
        return timer if timer.since is None else replace(timer, since=None)
    since = now if timer.since is None else timer.since
    delay = kind.on_delay_s if condition else kind.off_delay_s
    return Timer(on=condition) if now - since >= delay else Timer(timer.on, since)


@dataclass(frozen=True)
class DeadBand:
    """Limits of a measured value.

    Attributes
    ----------
    comes, goes : the condition comes at a value of ``comes`` or beyond and goes at ``goes`` or before; ``goes`` above
        ``comes`` is a condition that comes when the value is small
    """

    comes: float
    goes: float


def beyond(value: float, limits: DeadBand, was: bool) -> bool:
    """Test whether the condition holds, given whether it did; a value that is not a number changes nothing."""
    rising = limits.goes <= limits.comes
    sign = 1.0 if rising else -1.0
    if sign * value >= sign * limits.comes:
        return True
    if sign * value <= sign * limits.goes:
        return False
    return was
