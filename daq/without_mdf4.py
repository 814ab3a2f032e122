"""Imported first by programs of child processes that talk to a CAN bus, to start sooner.

Where asammdf is installed (the extra ``export``), python-can loads it, and pandas with it, for a reader and a writer
that such a process never uses: 0.6 s of processor time at every start. To these programs it is not installed.
"""

from __future__ import annotations

import sys

PROGRAMS = ("daq.acquisition.acquisition_child", "sim_backends.devices.canopen_nodes")

_program = getattr(sys.modules["__main__"], "__spec__", None)
if _program is not None and _program.name in PROGRAMS:
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]
