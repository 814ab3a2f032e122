"""Principals that are known: devices, API keys, pairing; and the layer in front of all routes.

- :mod:`server.access.pairing`: one-time codes that become device tokens
- :mod:`server.access.holder_store`: devices and API keys, stored hashed
- :mod:`server.access.access_desk`: all of it behind one object, :class:`~server.access.access_desk.Access`
- :mod:`server.access.gate`: the ASGI layer that says who asks, limits how often, and writes the audit log

What a principal may do is decided in :mod:`server.platform.authorization`.
"""
