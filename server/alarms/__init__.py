"""Alarms: what is wrong now, who has seen it, and what may be quiet for a while.

- :mod:`server.alarms.alarm_lifecycle`: when something counts as wrong, by delays and dead-band; raised, acknowledged,
  cleared, shelved; pure functions
- :mod:`server.alarms.alarm_desk`: the same in the store, and what the rest of the service reports to,
  :class:`~server.alarms.alarm_desk.Alarms`
- :mod:`server.alarms.alarm_resource`: routes; looks at acquisition, channels and disk once a second
"""
