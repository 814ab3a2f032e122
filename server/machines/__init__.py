"""Machines: the versions of their files, their acquisition, and the simulated one.

- :mod:`server.machines.machine_uploads`: files are checked in a process of their own
  (:mod:`server.machines.inspect_machine`) before they are stored
- :mod:`server.machines.acquisition`: one process per machine, kept alive
- :mod:`server.machines.simulation`: the simulated machine of ``hilfit serve --simulate``
- :mod:`server.machines.machine_desk`: all of it behind one object, :class:`~server.machines.machine_desk.MachineDesk`
"""
