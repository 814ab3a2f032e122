"""A new resource is one folder: a toy in a temporary package is served, guarded, kept and backed up."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from access_fakes import Guarded, guarded_service
from fastapi import APIRouter
from service_fakes import API, Fakes

from server.audit.audit_resource import Audit
from server.backups.backup_archive import Backups
from server.composition.app import check_declaration, create_app
from server.composition.declarations import RESOURCES
from server.platform.authorization.guard import TypedRoute, require
from server.platform.database.schema import metadata
from server.platform.resource import Resource, kept_lists, providers_of, tables_of
from server.platform.service import Service
from server.platform.settings import Settings

#: The folder of the toy, by file.
FOLDER = {
    "__init__": '"""Toys of machines."""\n',
    "toy_store": """
from server.jobs.job_store import Jobs
from server.platform.database.repository import Repository
from server.platform.database.stored import Id, OfJob, OfMachine, Stored


class Toy(Stored, table="toys", noun="toy", created="id", label="id"):
    id: Id
    job: OfJob
    machine: OfMachine


class Toys(Repository[Toy]):
    of = Toy

    def add(self, machine):
        count = len(self.all())
        toy = Toy(id=f"toy-{count}", job=f"job-of-toy-{count}", machine=machine)
        with self._database.write("toys", "jobs") as connection:
            Jobs(self._database).insert(
                connection, id=toy.job, kind="toy", label="Play", subject=toy.id, stages=("play",)
            )
            self.put(connection, toy)
        return toy
""",
    "toy_job": """
from server.jobs.job_kinds import NUMERICAL
from server.platform.processes.children import ChildResult


class ToyKind:
    name, queue = "toy", NUMERICAL

    def __init__(self, files):
        self._files = files

    def words(self, stage):
        return "Playing"

    def directory(self, job):
        return self._files.root / "toys" / job.subject

    def inputs(self, job):
        return ()

    def run(self, run):
        (run.place / "played.txt").write_text("played")
        return ChildResult("done")

    def result(self, job, place):
        return None

    def ended(self, job, state, error):
        pass
""",
    "toy_routes": """
from fastapi import APIRouter
from server.jobs.job_runner import JobRunner
from server.platform.authorization.guard import PrincipalDep, require
from server.platform.authorization.named_things import MachineName
from server.platform.authorization.guard import TypedRoute
from server.platform.http.bodies import Body, Listed
from server.platform.http.route_parameters import ServiceDep
from toys.toy_store import Toy, Toys

router = APIRouter(prefix="/toys", tags=["toys"], route_class=TypedRoute)


class ToyOrder(Body):
    machine: MachineName


class ToyResource(Toy):
    pass


class ToyList(Listed[ToyResource]):
    pass


@router.post("", status_code=202, dependencies=[require("engineer")])
def make(body: ToyOrder, service: ServiceDep) -> dict[str, str]:
    toy = service[Toys].add(body.machine)
    service[JobRunner].enqueue(toy.job)
    return {"id": toy.id, "job": toy.job}


@router.get("", dependencies=[require("read")])
def list_toys(service: ServiceDep, principal: PrincipalDep) -> ToyList:
    return ToyList.of(service[Toys].list(50, machines=principal.machines))


@router.get("/{id}", dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> ToyResource:
    return ToyResource.of(service[Toys].get(id))
""",
    "toy_resource": """
from functools import partial
from prometheus_client.core import GaugeMetricFamily
from server.jobs.job_places import named_results
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.resource import BackedUp, Phase, Resource, Running
from toys.toy_job import ToyKind
from toys.toy_routes import router
from toys.toy_store import Toy, Toys

told = []


def _running(parts):
    yield Running(Phase.WATCHING, lambda: told.append("started"), lambda: told.append("stopped"))


def _metrics(parts):
    yield GaugeMetricFamily("toys", "Toys.", value=len(parts[Toys].all()))


TOYS = Resource(
    name="toys",
    routers=(router,),
    tables=(Toy.table,),
    of_a_machine={"toys": Toy.table},
    kept={"/toys": ("toys",)},
    provides={
        Toys: lambda parts: Toys(parts[Database]),
        ToyKind: lambda parts: ToyKind(parts[DataDirectory]),
    },
    job_kinds=(ToyKind,),
    running=_running,
    backed_up=BackedUp("toys", partial(named_results, Toy.table)),
    metrics=_metrics,
)
""",
}


@pytest.fixture(scope="module")
def toys(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The toy's declaration, from a package of which the server knows nothing."""
    place = tmp_path_factory.mktemp("package")
    (place / "toys").mkdir()
    for name, text in FOLDER.items():
        (place / "toys" / f"{name}.py").write_text(text)
    sys.path.insert(0, str(place))
    try:
        yield import_module("toys.toy_resource")
    finally:
        sys.path.remove(str(place))
        metadata.remove(metadata.tables["toys"])
        for name in [name for name in sys.modules if name.partition(".")[0] == "toys"]:
            del sys.modules[name]


@pytest.fixture(scope="module")
def guarded(toys: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    assert toys.told == []
    with guarded_service(tmp_path_factory.mktemp("data"), resources=(*RESOURCES, toys.TOYS)) as running:
        assert toys.told == ["started"]
        yield running
    assert toys.told == ["started", "stopped"]


@pytest.fixture(scope="module")
def toy(guarded: Guarded) -> dict[str, str]:
    """A toy of the machine lever, whose job is done."""
    answer = guarded.client.post(f"{API}/toys", json={"machine": "lever"}, headers=guarded.bearer("engineer"))
    assert answer.status_code == 202, answer.text
    made: dict[str, str] = answer.json()
    assert guarded.running.follow(made["job"])[-1]["state"] == "done"
    return made


@pytest.mark.slow
def test_it_is_served_and_described(guarded: Guarded, toy: dict[str, str]) -> None:
    found = guarded.client.get(f"{API}/toys/{toy['id']}", headers=guarded.bearer("viewer"))
    assert found.json() == {**toy, "machine": "lever"}
    paths = guarded.client.get(f"{API}/openapi.json").json()["paths"]
    assert set(paths[f"{API}/toys"]) == {"get", "post"}
    assert "304" in paths[f"{API}/toys"]["get"]["responses"], "its list is kept"


@pytest.mark.slow
def test_it_is_in_the_access_matrix(guarded: Guarded, toy: dict[str, str]) -> None:
    assert guarded.client.get(f"{API}/toys").status_code == 401
    body = {"machine": "lever"}
    assert guarded.client.post(f"{API}/toys", json=body, headers=guarded.bearer("viewer")).status_code == 403
    other, own = guarded.bearer("engineer", ("other",)), guarded.bearer("engineer", ("lever",))
    assert guarded.client.post(f"{API}/toys", json=body, headers=other).status_code == 404
    for path in (f"toys/{toy['id']}", f"jobs/{toy['job']}"):
        assert guarded.client.get(f"{API}/{path}", headers=other).status_code == 404
        assert guarded.client.get(f"{API}/{path}", headers=own).status_code == 200
    assert guarded.client.get(f"{API}/toys", headers=other).json()["items"] == []


def test_what_was_done_to_it_is_in_the_audit_log(guarded: Guarded, toy: dict[str, str]) -> None:
    entries = guarded.running.service[Audit].list(50, 0, action="toys.").items
    assert {entry.action for entry in entries} == {"toys.make"}


def test_its_list_is_kept_until_it_changes(guarded: Guarded, toy: dict[str, str]) -> None:
    headers = guarded.bearer("engineer")
    first = guarded.client.get(f"{API}/toys", headers=headers)
    known = headers | {"If-None-Match": first.headers["etag"]}
    assert guarded.client.get(f"{API}/toys", headers=known).status_code == 304
    made = guarded.client.post(f"{API}/toys", json={"machine": "other"}, headers=headers).json()
    changed = guarded.client.get(f"{API}/toys", headers=known)
    assert changed.status_code == 200
    assert made["id"] in [row["id"] for row in changed.json()["items"]]


def test_rows_of_a_new_resource_are_counted_in_the_metrics(guarded: Guarded, toy: dict[str, str]) -> None:
    text = guarded.client.get("/metrics", headers=guarded.bearer("viewer")).text
    (line,) = (line for line in text.splitlines() if line.startswith("toys "))
    assert float(line.split()[1]) >= 1


def test_its_files_are_in_a_backup(guarded: Guarded, toy: dict[str, str]) -> None:
    backups = guarded.running.service[Backups]
    made = backups.make()
    assert made.missing == ()
    (played,) = (backups.directory / made.id / "toys" / toy["id"]).rglob("played.txt")
    assert played.read_text() == "played"


def test_what_a_declaration_forgets_is_refused() -> None:
    routes = APIRouter(prefix="/toys", route_class=TypedRoute)
    routes.add_api_route("/{id}", lambda id: None, dependencies=[require("read")])
    with pytest.raises(TypeError, match="of which machine 'toys' are"):
        check_declaration(Resource("toys", (routes,)), {"machines"})
    check_declaration(Resource("toys", (routes,), of_no_machine=frozenset({"toys"})), {"machines"})
    check_declaration(Resource("toys", (routes,)), {"machines", "toys"})
    with pytest.raises(TypeError, match=r"'/toys'.*no GET route answers"):
        check_declaration(Resource("toys", (routes,), kept={"/toys": ()}), {"toys"})
    with pytest.raises(TypeError, match=r"'/toys'.*no POST route answers"):
        check_declaration(Resource("toys", (routes,), large_uploads=frozenset({"/toys"})), {"toys"})
    with pytest.raises(ValueError, match=r"depends on {'toys'}, which no table is called"):
        kept_lists((*RESOURCES, Resource("toys", kept={"/toys": ("toys",)})))
    with pytest.raises(ValueError, match=r"'toys' provides .*Audit"):
        providers_of((*RESOURCES, Resource("toys", provides={Audit: lambda parts: None})))


def test_a_part_that_nobody_provides_is_named(tmp_path: Path) -> None:
    parts = Service(Settings(data_dir=tmp_path), RESOURCES, Fakes().parts)
    try:
        create_app(parts)
        with pytest.raises(LookupError, match="no resource provides Path; add it to `provides`"):
            parts[Path]
    finally:
        parts.stop()


def test_parts_that_need_each_other_are_named(tmp_path: Path) -> None:
    round_about = Resource("toys", provides={int: lambda parts: parts[str], str: lambda parts: parts[int]})
    with pytest.raises(LookupError, match="int needs str needs int"):
        Service(Settings(data_dir=tmp_path), (*RESOURCES, round_about), Fakes().parts)


@pytest.mark.slow
def test_every_table_is_declared_by_one_resource() -> None:
    tables = tables_of(RESOURCES)
    assert len(tables) == len(set(tables))
    assert {table.name for table in tables} == set(metadata.tables) - {"toys"}
