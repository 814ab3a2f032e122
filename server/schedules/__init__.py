"""Recalibration by the clock.

- :mod:`server.schedules.slots`: when a schedule's slots are; pure functions
- :mod:`server.schedules.clock`: gives slots their turn
- :mod:`server.schedules.resources`: what the REST interface takes and gives
"""
