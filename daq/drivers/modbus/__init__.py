"""Modbus TCP and RTU: ``driver`` polls, ``unit`` is what is known of one unit, ``client`` reads by pymodbus."""
