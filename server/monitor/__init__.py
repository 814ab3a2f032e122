"""Residual monitor: measured minus predicted effort, live, against the active calibration.

- :mod:`server.monitor.cusum`: cumulative sums with a stated false-alarm rate; pure functions
- :mod:`server.monitor.model`: the fitted model of an identification, evaluated on the last seconds of a ring buffer
- :mod:`server.monitor.scores`: a block of residual as a few numbers, each aimed at one kind of change
- :mod:`server.monitor.watcher`: learns what is usual, then watches; a pure state machine
- :mod:`server.monitor.child`: the process that does it, one per machine
- :mod:`server.monitor.supervisor`: starts the processes, keeps their states, raises alarms, asks for recalibrations
"""

from server.monitor.supervisor import CalibrationInUse, Calibrations, Monitors, Recalibrate

__all__ = ["CalibrationInUse", "Calibrations", "Monitors", "Recalibrate"]
