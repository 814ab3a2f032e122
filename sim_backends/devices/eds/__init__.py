"""EDS files of the simulated CANopen devices, one per kind (:mod:`sim_backends.devices.object_dictionaries`)."""
