"""Devices on the simulated buses: the hub, CANopen nodes, Modbus devices, and how they are wired."""
