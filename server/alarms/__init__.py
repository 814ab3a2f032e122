"""Alarms: what is wrong now, who has seen it, and what may be quiet for a while.

- :mod:`server.alarms.conditions`: when something counts as wrong; delays and dead-band; pure functions
- :mod:`server.alarms.lifecycle`: raised, acknowledged, cleared, shelved; pure functions
- :mod:`server.alarms.store`: the same in the store
- :mod:`server.alarms.desk`: what the rest of the service reports to, :class:`Alarms`
- :mod:`server.alarms.watch`: looks at acquisition, channels and disk once a second
"""

from server.alarms.conditions import KINDS, Kind
from server.alarms.desk import Alarms
from server.alarms.lifecycle import Alarm

__all__ = ["KINDS", "Alarm", "Alarms", "Kind"]
