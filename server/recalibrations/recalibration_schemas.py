"""What the routes of recalibrations give."""

from __future__ import annotations

from server.recalibrations.recalibration_store import Recalibration


class RecalibrationResource(Recalibration):
    """A recalibration; its id is the ``subject`` of its job. What it has not come to is null.

    ``recordings``: ids by role. ``comparison``: errors per joint on the newest recordings, of the active calibration
    (``before``) and of the new one (``after``).
    """
