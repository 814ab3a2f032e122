"""Who may do what.

- :mod:`server.access.principals`: principals, roles, scopes, machine binding
- :mod:`server.access.pairing`: one-time codes that become device tokens
- :mod:`server.access.store`: devices and API keys, stored hashed
- :mod:`server.access.desk`: all of it behind one object, :class:`~server.access.desk.Access`
- :mod:`server.access.layer`: the ASGI layer that says who asks, limits how often, and writes the audit log
- :mod:`server.access.guard`: what routes declare, ``dependencies=[require("operate")]``
- :mod:`server.access.machines`: to which machine something belongs

Only the principals are imported here: the desk needs the audit log, which needs them; the guard needs the service,
which needs the desk.
"""

from server.access.principals import LOCAL, SERVICE, Principal

__all__ = ["LOCAL", "SERVICE", "Principal"]
