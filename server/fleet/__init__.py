"""The fleet: all machines at a glance, each with its residual, its calibration and its alarms."""
