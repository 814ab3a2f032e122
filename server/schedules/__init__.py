"""Recalibration by the clock.

- :mod:`server.schedules.schedule_slots`: when a schedule's slots are; pure functions
- :mod:`server.schedules.schedule_clock`: gives slots their turn; recalibrates now, by hand or because a residual drifts
"""
