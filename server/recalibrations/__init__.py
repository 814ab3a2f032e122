"""Recalibrations: record, fit, compare with the active calibration, propose a new one.

- :mod:`server.recalibrations.recalibration_job`: the stages
- :mod:`server.recalibrations.recalibration_recording`: its recordings, of normal operation or of the standard motion
- :mod:`server.recalibrations.recalibration_comparison`: the table of errors before and after; pure functions
- :mod:`server.recalibrations.recalibration_site`: the machines of a running service, as a recalibration sees them
"""
