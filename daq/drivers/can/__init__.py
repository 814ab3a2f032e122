"""CAN behind python-can, whatever is spoken on it.

- :mod:`~daq.drivers.can.port`: an open interface, its receive thread, and what it does when it fails
- :mod:`~daq.drivers.can.health`, ``arrival``, ``receive_queue``: its controller, times of frames, the kernel's queue
- :mod:`~daq.drivers.can.socketcand`: the client of a gateway
- :mod:`~daq.drivers.can.bus_driver`: what all drivers do about a port: open it, watch it, rebuild it
- :mod:`~daq.drivers.can.pace`: how often a frame comes, and whether two devices send it
- :mod:`~daq.drivers.can.listening`: a bus that is only listened to
- :mod:`~daq.drivers.can.signals`: the driver of plain CAN and J1939, by DBC files
"""
