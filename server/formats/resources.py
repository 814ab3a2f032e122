"""What ``GET /recordings/{id}/statistics`` gives."""

from __future__ import annotations

from pydantic import BaseModel


class ChannelStatistics(BaseModel):
    """One channel in the unit of the file; null where no value is finite."""

    minimum: float | None
    maximum: float | None
    mean: float | None
    std: float | None
    missing: int
    quality: dict[str, int]


class RecordingStatistics(BaseModel):
    """A recording's rows, its time in s, its gaps (steps of more than one and a half periods), and its channels."""

    rows: int
    seconds: float
    rate_hz: float
    gaps: int
    channels: dict[str, ChannelStatistics]
