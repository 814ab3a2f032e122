"""CAN behind python-can, whatever is spoken on it.

- :mod:`~daq.drivers.can.port`: an open interface, its receive thread, times of frames, and what it does when it fails
- :mod:`~daq.drivers.can.health`: its controller, and what drivers do about its state
- :mod:`~daq.drivers.can.socketcand`: the client of a gateway
- :mod:`~daq.drivers.can.signals`: the driver of plain CAN and J1939, by DBC files
"""
