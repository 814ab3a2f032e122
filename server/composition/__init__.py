"""The service put together of its resources, and the processes that run it.

- :mod:`server.composition.declarations`: all resources, found in their folders
- :mod:`server.composition.app`: the HTTP application in front of them
- :mod:`server.composition.serve`, :mod:`server.composition.worker`: ``hilfit serve`` and ``hilfit worker``
"""
