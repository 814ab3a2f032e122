"""The hub when it gets to run seldom: nodes that answer every SYNC are heard as often as they are asked."""

from __future__ import annotations

import contextlib
import socket

from sim_backends import backplane
from sim_backends.devices.can_hub import SYNCS_WAITING, Hub

STATE = backplane.STATE + backplane.pack_state(0, b"")
LOOKS = 200


def test_nodes_are_heard_as_often_as_they_are_asked():
    """At each look a client has as many SYNCs waiting as the hub takes, and the nodes have answered the last ones.

    A hub that takes one packet of theirs for eight SYNCs lets them wait for it for ever, and whoever asks them for
    anything else waits behind all the SYNCs that they have not seen yet.
    """
    with contextlib.ExitStack() as stack:
        (plant, plants), (nodes, own), (modbus, units) = (backplane.pair() for _ in range(3))
        for end in (plant, plants, nodes, own, modbus, units):
            stack.enter_context(end)
        plant.send(STATE)
        hub = stack.enter_context(contextlib.closing(Hub("can0", plants, own, units)))
        client = stack.enter_context(socket.create_connection(("127.0.0.1", hub.port), timeout=60))
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for command in (b"", b"< open can0 >", b"< rawmode >"):
            client.sendall(command)
            hub.look()
            client.recv(256)
        nodes.setblocking(False)
        heard = 0
        for look in range(LOOKS):
            for _ in range(SYNCS_WAITING):
                plant.send(STATE)
            client.sendall(SYNCS_WAITING * b"< send 80 0 >")
            hub.look()
            for _ in range(SYNCS_WAITING):
                assert plant.recv(256) == backplane.STEP
                assert nodes.recv(256)[:1] == backplane.SYNC
                nodes.send(backplane.TEXT + b"<>")  # raises where nobody takes it
            heard += 0 if look == 0 else len(client.recv(1 << 16)) // len(b"<>")
        assert heard == (LOOKS - 1) * SYNCS_WAITING
