"""Bus drivers: what one is (:mod:`~daq.drivers.base`), CANopen, Modbus, and the check that every driver has to pass."""

from daq.drivers.base import (
    DeviceStatus,
    Driver,
    DriverContext,
    DriverStatistics,
    Samples,
    make_driver,
    nothing,
)

__all__ = [
    "DeviceStatus",
    "Driver",
    "DriverContext",
    "DriverStatistics",
    "Samples",
    "make_driver",
    "nothing",
]
