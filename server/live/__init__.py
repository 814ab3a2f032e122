"""Live signals, events and status for pages; one reader per machine, any number of clients, nobody waited for.

- :mod:`server.live.live_messages`: what goes over the WebSocket, pure functions of frames
- :mod:`server.live.live_reader`: one thread per machine that somebody looks at, from its ring buffer to the queues of
  all clients; one that does not keep up is dropped
- :mod:`server.live.revisions`: revision counters, read once for all who follow ``/events``
- :mod:`server.live.live_resource`: routes; the service at a glance, for ``/status``
"""
