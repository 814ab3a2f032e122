"""The resource ``machines``: machine files, acquisition, the simulated machine."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import sqlalchemy as sa
from prometheus_client.core import Metric

from daq import Machine
from daq.acquisition.acquisition import AcquisitionProcess
from server.machines.acquisition import Acquisition, Launch
from server.machines.acquisition_metrics import acquisition_metrics
from server.machines.faults.fault_routes import BREAKABLE
from server.machines.faults.fault_routes import router as fault_router
from server.machines.machine_desk import BEING_RECORDED, MachineDesk, Simulate
from server.machines.machine_reader import MachineReader
from server.machines.machine_routes import router
from server.machines.machine_store import Machines, machine_versions, machines
from server.machines.machine_uploads import MachineUploads
from server.machines.simulation import simulated_machine
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.processes.file_children import FileChildren
from server.platform.resource import BackedUp, NamedFiles, Phase, Resource, Running
from server.platform.settings import Settings


@contextmanager
def acquire(machine: Machine, data_directory: Path | None = None) -> Iterator[AcquisitionProcess]:
    """Start acquiring a machine; a device that is not there is missing and costs only itself.

    What CANopen nodes were like before is kept in ``data_directory``.
    """
    process = AcquisitionProcess(machine, strict=False, data_directory=data_directory)
    process.start()
    try:
        yield process
    finally:
        process.stop()


LAUNCH: PartName[Launch] = PartName("what starts an acquisition")
SIMULATE: PartName[Simulate] = PartName("what starts the simulated machine")


def _file_children(parts: Parts) -> FileChildren:
    children = FileChildren()
    parts.at_close(children.close)
    return children


def _desk(parts: Parts) -> MachineDesk:
    return MachineDesk(
        parts[Machines], parts[MachineUploads], parts[Acquisition], parts[DataDirectory], parts[BEING_RECORDED]
    )


def _running(parts: Parts) -> Iterator[Running]:
    settings, desk = parts[Settings], parts[MachineDesk]

    def simulate() -> None:
        if settings.simulate:
            directory = parts[DataDirectory].simulation
            desk.add_simulated(parts.entered(parts[SIMULATE](directory, settings.simulation_speed)))

    yield Running(Phase.SIMULATION, start=simulate)
    yield Running(Phase.ACQUISITION, start=desk.start_acquisition, stop=parts[Acquisition].stop_all)


def _files(connection: sa.Connection) -> NamedFiles:
    versions = connection.execute(sa.select(machine_versions.c.name, machine_versions.c.version))
    rows = [(row.name, row.version) for row in versions]
    return NamedFiles(
        needed=frozenset(f"machines/{name}/{version}.yaml" for name, version in rows),
        others=frozenset(f"machines/{name}" for name, _ in rows),  # DBC and EDS files beside them
    )


def _metrics(parts: Parts) -> Iterator[Metric]:
    return acquisition_metrics(parts[Acquisition])


MACHINES = Resource(
    name="machines",
    routers=(router, fault_router),
    tables=(machines, machine_versions),
    kept={"/machines": ("machines",)},
    provides={
        LAUNCH: lambda parts: partial(acquire, data_directory=parts[Settings].data_dir),
        SIMULATE: lambda parts: simulated_machine,
        BREAKABLE: lambda parts: None,
        Machines: lambda parts: Machines(parts[Database]),
        FileChildren: _file_children,
        MachineReader: lambda parts: MachineReader(parts[DataDirectory], parts[FileChildren]),
        MachineUploads: lambda parts: MachineUploads(parts[Database], parts[DataDirectory], parts[MachineReader]),
        Acquisition: lambda parts: Acquisition(parts[LAUNCH], parts[Changes].notify, parts[Settings].bus_places),
        MachineDesk: _desk,
    },
    running=_running,
    backed_up=BackedUp("machines", _files),
    metrics=_metrics,
)
