"""Calibrations: identifications that a person approved. One is active per machine; the old ones stay.

- :mod:`server.calibrations.content`: what a calibration takes from a report
- :mod:`server.calibrations.store`: states and who brought them about
- :mod:`server.calibrations.comparison`: two of them side by side
- :mod:`server.calibrations.desk`: all of it behind one object, :class:`Calibrations`
"""

from server.calibrations.desk import ByPolicy, Calibrations
from server.calibrations.store import Calibration

__all__ = ["ByPolicy", "Calibration", "Calibrations"]
