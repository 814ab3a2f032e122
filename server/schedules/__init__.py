"""Recalibration by the clock.

- :mod:`server.schedules.schedule_slots`: when a schedule's slots are; pure functions
- :mod:`server.schedules.schedule_clock`: gives slots their turn
- :mod:`server.schedules.recalibration_orders`: recalibrates now, by hand or because a residual drifts
"""
