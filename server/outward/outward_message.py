"""Messages to other systems: one value, whoever takes it. Its fields are only added to, never renamed."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cache
from typing import Any, Literal

import orjson
from pydantic import TypeAdapter

from server.alarms.alarm_lifecycle import Severity

#: Code and values of the text beside it, to word it in another language.
MadeOf = dict[str, Any] | None
Kind = Literal["state", "result", "alarm", "test"]


@dataclass(frozen=True)
class StateData:
    """State of a machine's acquisition; ``error``: why it waits."""

    acquisition: Literal["off", "starting", "running", "waiting", "stopped"]
    error: str | None = None
    error_message: MadeOf = None


@dataclass(frozen=True)
class ResultData:
    """A job that is over; ``verdict``: of an identification, ``path``: of what the job made, on this service."""

    job: str
    kind: str
    label: str
    state: Literal["done", "failed", "cancelled"]
    error: str | None
    subject: str
    path: str
    verdict: str | None
    started: str | None
    ended: str | None
    error_message: MadeOf = None


@dataclass(frozen=True)
class AlarmData:
    """An alarm as it is since then: raised, acknowledged, shelved, cleared."""

    id: str
    kind: str
    text: str
    severity: Severity
    state: Literal["active", "cleared"]
    acknowledged: bool
    acknowledged_by: str | None
    shelved_until: str | None
    raised: str
    cleared: str | None
    count: int
    text_message: MadeOf = None


@dataclass(frozen=True)
class TrialData:
    """Somebody tries whether messages arrive."""

    text: str = "a test: no machine said this"


@dataclass(frozen=True)
class Message:
    """One message.

    Attributes
    ----------
    id : the same however often it is sent: a receiver drops what it has
    type : which kind of ``data``
    machine : None: the service as a whole
    timestamp : when it became so; ISO 8601, UTC
    """

    id: str
    type: Kind
    machine: str | None
    timestamp: str
    data: StateData | ResultData | AlarmData | TrialData

    @property
    def place(self) -> tuple[str, ...]:
        """Its place in a tree of the last messages: ``machines, NAME, alarms, KIND``."""
        owner = ("service",) if self.machine is None else ("machines", self.machine)
        return (*owner, "alarms", self.data.kind) if isinstance(self.data, AlarmData) else (*owner, self.type)

    def content(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self)

    def body(self) -> bytes:
        """Return the JSON text that is sent, and signed."""
        return orjson.dumps(self.content())


@cache
def schema() -> dict[str, Any]:
    """Return the JSON schema of a message."""
    return TypeAdapter(Message).json_schema()
