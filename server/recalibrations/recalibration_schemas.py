"""What the routes of recalibrations give."""

from __future__ import annotations

from typing import Any, Literal

from server.platform.http.bodies import Shown


class RecalibrationResource(Shown):
    """A recalibration; its id is the ``subject`` of its job. What it has not come to is null.

    ``recordings``: ids by role. ``comparison``: errors per joint on the newest recordings, of the active calibration
    (``before``) and of the new one (``after``).
    """

    id: str
    job: str
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    machine: str
    schedule: str | None
    label: str
    created: str
    recordings: dict[str, str]
    identification: str | None
    comparison: dict[str, Any] | None
    calibration: str | None
