"""The resource ``machines``: machine files, acquisition, the simulated machine."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any

import sqlalchemy as sa
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.utils import floatToGoString
from pydantic import BaseModel

from daq import Machine
from daq.acquisition.acquisition import AcquisitionProcess
from server.machines.acquisition import Acquisition, Launch
from server.machines.fault_routes import BREAKABLE
from server.machines.fault_routes import router as fault_router
from server.machines.machine_desk import BEING_RECORDED, MachineDesk, Simulate
from server.machines.machine_store import MachineRow, Machines, machine_versions, machines
from server.machines.machine_uploads import MachineReader, MachineUploads
from server.machines.simulation import simulated_machine
from server.platform.authorization.guard import Principal, PrincipalDep, TypedRoute, require
from server.platform.changes import Changes
from server.platform.database.engine import Database
from server.platform.errors import NotFoundError
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Flag, Listed
from server.platform.http.route_parameters import TEXT, KnownTags, PageDep, ServiceDep, problems, sends, takes
from server.platform.processes.file_children import FileChildren
from server.platform.resource import BackedUp, NamedFiles, PartName, Parts, Phase, Resource, Running
from server.platform.service import Service
from server.platform.settings import Settings

_STATES = ("off", "starting", "running", "waiting", "stopped")
_COUNTS = {
    "cycles": "Frames published.",
    "skipped": "Cycles that never happened because their time had passed.",
    "late": "Cycles that started more than a tenth of a period late.",
    "utc_jumps": "Times that the computer's clock was set.",
}


def _acquisition_metrics(acquisition: Acquisition) -> Iterator[Metric]:
    """Yield state, restarts and counts of every machine's acquisition."""
    running = GaugeMetricFamily(
        "hilfit_acquisition_state",
        "1 for the state that a machine's acquisition is in.",
        labels=["machine", "state"],
    )
    restarts = CounterMetricFamily("hilfit_acquisition_restarts", "Restarts of acquisition.", labels=["machine"])
    counts = {
        name: CounterMetricFamily(f"hilfit_acquisition_{name}", text, labels=["machine"])
        for name, text in _COUNTS.items()
    }
    quality = CounterMetricFamily(
        "hilfit_channel_frames", "Frames of a channel by quality.", labels=["machine", "channel", "quality"]
    )
    lateness = HistogramMetricFamily(
        "hilfit_acquisition_lateness_seconds", "How late cycles started.", labels=["machine"]
    )
    for machine in acquisition.names():
        statistics = acquisition.statistics(machine)
        for state in _STATES:
            running.add_metric([machine, state], float(statistics["state"] == state))
        restarts.add_metric([machine], statistics.get("restarts", 0))
        found = statistics.get("counts", {})
        for name, family in counts.items():
            family.add_metric([machine], found.get(name, 0))
        if found.get("lateness"):
            lateness.add_metric([machine], _buckets(found["lateness"]), found["lateness_ms"] / 1e3)
        for channel, by_quality in found.get("quality", {}).items():
            for name, number in by_quality.items():
                quality.add_metric([machine, channel, name], number)
    yield from (running, restarts, *counts.values(), lateness, quality)


def _buckets(lateness: Mapping[str, int]) -> list[tuple[str, float]]:
    """Convert counts between bounds in ms to bounds in s and how many are not above each (Prometheus)."""
    bounds = (floatToGoString(float(bound) / 1e3) for bound in lateness)  # type: ignore[no-untyped-call]
    return list(zip(bounds, accumulate(lateness.values()), strict=True))


class MachineSummary(MachineRow):
    """A machine: its current version, and whether it is acquired."""


class MachineCheck(BaseModel):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(MachineSummary):
    """A machine with its validated file and the state of its acquisition."""

    versions: list[int]
    machine: dict[str, Any]
    acquisition: dict[str, Any]


class MachineList(Listed[MachineSummary]):
    """A page of machines; ``next`` is the cursor of the next page."""


class AcquisitionWish(Body, json_schema_extra={"examples": [{"enabled": True}]}):
    """Whether acquisition of a machine should run."""

    enabled: Flag


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)
YAML = "application/yaml"
Version = Annotated[int | None, Query(ge=1, le=2**53, description="By default the current one")]
_FILE = takes({YAML: TEXT}, "The text of a machine file (YAML, or JSON, which is YAML too)")


@router.post(
    "",
    status_code=201,
    responses={200: {"model": MachineSummary}, **problems(404, 409, 412, 413, 422)},
    openapi_extra=_FILE,
    dependencies=[require("engineer")],
)
async def upload(
    request: Request, response: Response, service: ServiceDep, principal: PrincipalDep, tags: KnownTags
) -> MachineSummary:
    """Upload a machine file: a new machine or a new version (200 if it is the current version already)."""
    async with service.heavy.place(principal.id) as place:
        row, made = await place.run(service[MachineDesk].upload, await request.body(), principal.may_see, tags)
    response.status_code = 201 if made else 200
    response.headers["Location"] = f"/api/v1/machines/{row.name}"
    response.headers["ETag"] = f'"{row.current}"'
    return MachineSummary.of(row)


@router.post("/check", responses=problems(404, 409, 413, 422), openapi_extra=_FILE, dependencies=[require("engineer")])
async def check(request: Request, service: ServiceDep, principal: PrincipalDep) -> MachineCheck:
    """Check a machine file as an upload of it would; nothing is stored."""
    async with service.heavy.place(principal.id) as place:
        name, version = await place.run(service[MachineDesk].check, await request.body(), principal.may_see)
    return MachineCheck(name=name, version=version)


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_machines(service: ServiceDep, page: PageDep) -> MachineList:
    """List machines; ``label`` is looked for in their names, and a machine's time is that of its current version."""
    return MachineList.of(service[Machines].list(**page))


@router.get("/{name}", responses=problems(404, 422), dependencies=[require("read")])
async def get(
    name: str, response: Response, service: ServiceDep, principal: PrincipalDep, version: Version = None
) -> MachineDetail:
    """Read a machine: its file, validated, as JSON, and the state of its acquisition."""
    detail = await _detail(service, principal, name, version)
    response.headers["ETag"] = f'"{detail.current}"'
    return detail


@router.get("/{name}/file", **sends({YAML: TEXT}, 404, 422), dependencies=[require("read")])
def file(name: str, service: ServiceDep, version: Version = None) -> Response:
    """Read a machine file as it was uploaded."""
    row = service[Machines].get(name, version)
    content = service.files.machine_file(name, row.version).read_bytes()
    return Response(content, media_type=YAML, headers={"ETag": f'"{row.current}"'})


@router.put("/{name}/acquisition", responses=problems(404, 409, 422), dependencies=[require("engineer")])
async def acquisition(name: str, wish: AcquisitionWish, service: ServiceDep, principal: PrincipalDep) -> MachineDetail:
    """Start or stop acquiring a machine; restarts keep that."""
    await service.heavy.aside(service[MachineDesk].set_acquisition, name, wish.enabled)
    return await _detail(service, principal, name, None)


async def _detail(service: Service, principal: Principal, name: str, version: int | None) -> MachineDetail:
    row = await run_in_threadpool(service[Machines].get, name, version)
    path = service.files.machine_file(name, row.version)
    content = service[MachineReader].known(path)
    if content is None:  # not since this start: reading it takes a while
        if not path.is_file():
            raise NotFoundError("server.file_machine_gone", row=name)
        content = await service.heavy.run(principal.id, service[MachineReader].content, path)
    return MachineDetail(
        **row.__dict__,
        versions=[entry.version for entry in await run_in_threadpool(service[Machines].versions, name)],
        machine=content,
        acquisition=service[Acquisition].statistics(name),
    )


@contextmanager
def _acquire(machine: Machine, data_directory: Path | None = None) -> Iterator[AcquisitionProcess]:
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


MACHINES = Resource(
    name="machines",
    routers=(router, fault_router),
    tables=(machines, machine_versions),
    kept={"/machines": ("machines",)},
    provides={
        LAUNCH: lambda parts: partial(_acquire, data_directory=parts[Settings].data_dir),
        SIMULATE: lambda parts: simulated_machine,
        BREAKABLE: lambda parts: None,
        Machines: lambda parts: Machines(parts[Database]),
        FileChildren: _file_children,
        MachineReader: lambda parts: MachineReader(parts[DataDirectory], parts[FileChildren]),
        MachineUploads: lambda parts: MachineUploads(parts[Database], parts[DataDirectory], parts[MachineReader]),
        Acquisition: lambda parts: Acquisition(parts[LAUNCH], parts[Changes].notify, parts[Settings].bus_places),
        MachineDesk: lambda parts: MachineDesk(
            parts[Machines], parts[MachineUploads], parts[Acquisition], parts[DataDirectory], parts[BEING_RECORDED]
        ),
    },
    running=_running,
    backed_up=BackedUp("machines", _files),
    metrics=lambda parts: _acquisition_metrics(parts[Acquisition]),
)
