"""Tools for the days on which a machine is connected.

==============  ====================================================================================================
``can_scan``    who is on a CAN bus: listening first, asking only where that is allowed
``modbus_scan`` which units answer in a given range
``check``       every device of a machine: identity, units, mapping, latency, jitter, noise, zero, drift; to print, too
``delays``      how much later one bus is than another, estimated from what both of them see
``monitor``     values, ages and devices as they come
``wizard``      the ``buses`` and ``channels`` part of a machine file, from a scan, EDS and DBC files
==============  ====================================================================================================
"""

#: Schema of what ``hilfit bus scan -o`` writes and ``hilfit machine new`` reads.
SCAN_SCHEMA = "hilfit/scan/1"
