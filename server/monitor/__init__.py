"""Residual monitor: measured minus predicted effort, and speed by valve, live, against the active calibrations.

- :mod:`server.monitor.cusum`: cumulative sums with a stated false-alarm rate; pure functions
- :mod:`server.monitor.drift_watcher`: learns what is usual, then watches; a pure state machine
- :mod:`server.monitor.followed`: what is followed, the mechanics or the valves: a block of residual as a few numbers,
  each aimed at one kind of change
- :mod:`server.monitor.monitor_child`: the process that does it, one per active calibration
- :mod:`server.monitor.monitor_supervisor`: starts the processes, keeps their states, raises alarms, asks for
  recalibrations
"""
