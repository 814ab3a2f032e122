"""What the routes of signals over time take and give."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, Field, model_validator

from daq.recordings.recording import MINIMUM_SECONDS
from server.platform.http.bodies import Body, Label

Seconds = Annotated[float, Field(ge=0, le=1e7, allow_inf_nan=False)]


class ChannelTrace(BaseModel):
    """One channel, in its unit, per moment.

    ``high`` is null where each moment is one row: then ``low`` is its value. ``doubtful`` are the times from which to
    which a value was not measured in the row where it stands.
    """

    unit: str
    low: list[float | None]
    high: list[float | None] | None
    doubtful: list[tuple[float, float]]


class Signals(BaseModel):
    """Signals over time; moments are ``moment_s`` long, 0 for rows as they are.

    Times are seconds since 1970 for a machine, since the first row for a recording; ``first_utc`` is then the time of
    that row in seconds since 1970 where the recording has it.
    """

    start: float
    end: float
    moment_s: float
    first_utc: float | None
    time: list[float]
    channels: dict[str, ChannelTrace]


class Spectrum(BaseModel):
    """Power spectral density of one channel, unit^2/Hz, over frequency in Hz; ``seconds`` of it without a gap."""

    channel: str
    unit: str
    seconds: float
    frequency: list[float]
    density: list[float]


class RecordedEventResource(BaseModel):
    """What happened to a device: ``time`` in s since the first row; ``seconds`` null for what lasted on at the end."""

    time: float | None
    device: str
    what: str
    text: str
    seconds: float | None
    count: int


class RecordingRemarks(BaseModel):
    """What is said beside a recording: its events, and what ``hilfit check`` finds in it."""

    events: list[RecordedEventResource]
    findings: list[dict[str, Any]]


class Cut(Body, json_schema_extra={"examples": [{"start": 12.5, "end": 42.5, "label": "without the stop at the end"}]}):
    """A part of a recording, s since its first row."""

    start: Seconds
    end: Seconds
    label: Label = ""

    @model_validator(mode="after")
    def _forward(self) -> Cut:
        if self.end - self.start < MINIMUM_SECONDS:
            raise ValueError(f"end must be at least {MINIMUM_SECONDS:g} s later than start")
        return self
