"""Bus drivers, a folder for each family of buses (``can``, ``canopen``, ``modbus``).

What one is says :mod:`~daq.drivers.base`, :mod:`~daq.drivers.conformance` what each has to pass. Drivers that have one
port are a :mod:`~daq.drivers.bus_driver`, which also keeps devices; those that only listen a
:mod:`~daq.drivers.listening`.
"""

from daq.drivers.base import DeviceStatus, Driver, DriverContext, DriverStatistics, Samples, make_driver, nothing

__all__ = [
    "DeviceStatus",
    "Driver",
    "DriverContext",
    "DriverStatistics",
    "Samples",
    "make_driver",
    "nothing",
]
