"""What the routes of recordings take and give."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, Field

from server.platform.authorization.named_things import MachineName
from server.platform.http.bodies import Body, Label, Listed
from server.recordings.recording_store import RecordingRole, RecordingRow


class RecordingStart(
    Body,
    json_schema_extra={"examples": [{"machine": "folding-arm", "role": "train", "label": "morning", "seconds": 60}]},
):
    """Start recording a machine that is being acquired; without ``seconds`` until it is stopped."""

    machine: MachineName
    role: RecordingRole
    label: Label = ""
    seconds: Annotated[float, Field(gt=0, le=86400)] | None = None


class RecordingResource(RecordingRow):
    """A recording; ``statistics`` count rows, gaps and what the acquisition lost while it ran."""


class RecordingList(Listed[RecordingResource]):
    """A page of recordings."""


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
