"""Live signals and events for pages: one reader per machine, any number of clients, nobody waited for.

- :mod:`server.live.messages`: what goes over the WebSocket, pure functions of frames
- :mod:`server.live.client`: one client's outgoing queue; a client that does not keep up is dropped
- :mod:`server.live.reader`: one thread per machine that somebody looks at, from its ring buffer to all clients
- :mod:`server.live.revisions`: revision counters, read once for all who follow ``/events``
"""

from server.live.client import Client
from server.live.reader import Hub
from server.live.revisions import Revisions

__all__ = ["Client", "Hub", "Revisions"]
