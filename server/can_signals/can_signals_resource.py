"""The resource ``can_signals``: what the DBC files of machines offer, and these files."""

from __future__ import annotations

from server.can_signals.can_signals_routes import router
from server.can_signals.signal_files import SignalFiles
from server.machines.acquisition import Acquisition
from server.machines.machine_desk import BEING_RECORDED
from server.machines.machine_reader import MachineReader
from server.machines.machine_store import Machines
from server.platform.files import DataDirectory
from server.platform.processes.file_children import FileChildren
from server.platform.resource import Resource

CAN_SIGNALS = Resource(
    name="can_signals",
    routers=(router,),
    provides={
        SignalFiles: lambda parts: SignalFiles(
            parts[DataDirectory],
            parts[Machines],
            parts[MachineReader],
            parts[Acquisition],
            parts[BEING_RECORDED],
            parts[FileChildren],
        ),
    },
    large_uploads=frozenset({"/can-signals/upload"}),
)
