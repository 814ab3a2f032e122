"""The resource ``identifications``: both stages and the loop, from recordings."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse
from pydantic import Field, JsonValue

from fitting.pipeline.stage_names import NEXT_MOTION, ReportLanguage
from server.identifications.identification_job import IdentificationKind, StageProgram, fitting_program
from server.identifications.identification_order import IdentificationOrders, Orders, Wish
from server.identifications.identification_results import IdentificationResults
from server.identifications.identification_store import (
    Identification,
    Identifications,
    Ordered,
    RecordingChoice,
    identification_recordings,
    identifications,
)
from server.jobs.job_places import named_results
from server.jobs.job_runner import JobRunner
from server.platform.authorization.guard import TypedRoute, require
from server.platform.authorization.named_things import MachineName
from server.platform.database.engine import Database
from server.platform.errors import NotFoundError
from server.platform.files import DataDirectory
from server.platform.http.bodies import Body, Flag, Label, Listed
from server.platform.http.route_parameters import Idempotency, MachineQuery, PageDep, ServiceDep, problems, sends
from server.platform.resource import BackedUp, PartName, Resource
from server.platform.service import Service

#: What a fit is ordered of.
RecordingChoices = Annotated[list[RecordingChoice], Field(min_length=1, max_length=200)]
#: An order of one, as the OpenAPI description shows it.
ORDER_EXAMPLE: dict[str, JsonValue] = {
    "examples": [
        {
            "machine": "folding-arm",
            "recordings": [
                {"id": "rec-0123456789abcdef", "role": "train"},
                {"id": "rec-fedcba9876543210", "role": "validate"},
            ],
        }
    ]
}


class IdentificationOptions(Body):
    """Choices of an identification (:class:`fitting.loop.session.Options`).

    ``loop``: look for what the model lacks. ``bandwidth_hz``: identification bandwidth, None: from the motion.
    ``bootstrap``: most replicas that a null distribution is drawn from. ``forgetting``: factor of stage 1's recursion,
    1 forgets nothing. ``estimator``, ``covariance``: of stage 2. ``prior`` and ``columns`` name files: only the command
    line has them. ``resample``: stored recordings have the machine's rate already, so it changes nothing.
    """

    loop: Flag = True
    bandwidth_hz: Annotated[float, Field(gt=0)] | None = None
    bootstrap: Annotated[int, Field(ge=0, le=1000)] = 18
    forgetting: Annotated[float, Field(gt=0, le=1)] = 1.0
    estimator: Annotated[str, Field(max_length=64)] = "gls"
    covariance: Literal["hac", "bootstrap", "white"] = "hac"
    prior: None = None
    columns: None = None
    resample: bool = False


class FitOrder(Body, json_schema_extra=ORDER_EXAMPLE):
    """What is fitted; each kind has options of its own."""

    machine: MachineName
    recordings: RecordingChoices
    options: Body
    label: Label = ""

    async def taken(
        self, service: Service, orders: type[Orders[Ordered]], response: Response, key: str | None
    ) -> Ordered:
        """Store it and queue its job, whose address is in ``Location``; see :meth:`Orders.order`."""
        recordings = tuple((choice.id, choice.role) for choice in self.recordings)
        wish = Wish(self.machine, recordings, self.options.model_dump(), self.label)
        # Shared storage may have to be filled first, and may be far away.
        made = await service.heavy.aside(service[orders].order, wish, key)
        response.headers["Location"] = f"/api/v1/jobs/{made.job}"
        return made


class IdentificationOrder(FitOrder):
    """What to identify."""

    options: IdentificationOptions = IdentificationOptions()


class IdentificationResource(Identification):
    """An identification; ``verdict`` and ``overall`` are there once its job is done."""


class IdentificationList(Listed[IdentificationResource]):
    """A page of identifications."""


router = APIRouter(prefix="/identifications", tags=["identifications"], route_class=TypedRoute)
#: The report is a page of ours, but it shows names from machine files: it may load nothing from elsewhere, and has an
#: origin of its own, so it can ask nothing of the service. Its own policy, the first thing in it, names the digest of
#: the one script that may run. It is one file that is read without the service too, so its style sheet stands in it;
#: without requests an inline style can do no more than look wrong.
REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; font-src data:; "
    "sandbox allow-scripts"
)


@router.post("", status_code=202, responses=problems(404, 409, 422), dependencies=[require("engineer")])
async def order(
    body: IdentificationOrder, response: Response, service: ServiceDep, idempotency_key: Idempotency = None
) -> IdentificationResource:
    """Order an identification: its job is at ``Location``; one ``Idempotency-Key`` makes one job."""
    return IdentificationResource.of(await body.taken(service, IdentificationOrders, response, idempotency_key))


@router.get("", responses=problems(422), dependencies=[require("read")])
def list_identifications(service: ServiceDep, page: PageDep, machine: MachineQuery = None) -> IdentificationList:
    """List identifications, newest first."""
    return IdentificationList.of(service[Identifications].list(**page, machine=machine))


@router.get("/{id}", responses=problems(404, 422), dependencies=[require("read")])
def get(id: str, service: ServiceDep) -> IdentificationResource:
    """Read an identification."""
    return IdentificationResource.of(service[Identifications].get(id))


@router.get("/{id}/report.json", **sends({"application/json": {}}, 404, 409, 422), dependencies=[require("read")])
def report(id: str, service: ServiceDep) -> FileResponse:
    """Download the result (schema ``hilfit/report/1``)."""
    return FileResponse(service[IdentificationResults].written(id, "report.json"), media_type="application/json")


@router.get("/{id}/report.html", **sends({"text/html": {}}, 404, 409, 422), dependencies=[require("read")])
def report_page(
    id: str,
    service: ServiceDep,
    language: Annotated[ReportLanguage, Query(description="Of the page; one of an earlier version is English.")] = "en",
) -> FileResponse:
    """Download the result as a self-contained page."""
    english = service[IdentificationResults].written(id, "report.html")
    other = english.with_name(f"report.{language}.html")
    path, spoken = (other, language) if language != "en" and other.is_file() else (english, "en")
    response = FileResponse(path, media_type="text/html", headers={"Content-Language": spoken})
    response.headers["Content-Security-Policy"] = REPORT_POLICY
    return response


@router.get("/{id}/next-experiment.csv", **sends({"text/csv": {}}, 404, 409, 422), dependencies=[require("read")])
def next_experiment(id: str, service: ServiceDep) -> FileResponse:
    """Download the motion that separates what these recordings do not (a motion file); 404 if none was designed."""
    path = service[IdentificationResults].written(id, "report.json").with_name(NEXT_MOTION)
    if not path.is_file():
        raise NotFoundError("server.identification_designed_no_next", id=id)
    return FileResponse(path, media_type="text/csv", filename=f"{id}-{NEXT_MOTION}")


#: The stages of an identification, and the command that runs one; called when the first job needs it.
STAGE_PROGRAM: PartName[Callable[[], StageProgram]] = PartName("stages of an identification")


IDENTIFICATIONS = Resource(
    name="identifications",
    routers=(router,),
    tables=(identifications, identification_recordings),
    of_a_machine={"identifications": identifications},
    kept={"/identifications": ("identifications",)},
    provides={
        STAGE_PROGRAM: lambda parts: fitting_program,
        Identifications: lambda parts: Identifications(parts[Database]),
        IdentificationResults: lambda parts: IdentificationResults(parts[Database], parts[DataDirectory]),
        IdentificationKind: lambda parts: IdentificationKind(
            parts[Database], parts[DataDirectory], parts[STAGE_PROGRAM]
        ),
        IdentificationOrders: lambda parts: IdentificationOrders(
            parts[Database],
            lambda: parts[IdentificationKind].stages,
            lambda job: parts[JobRunner].enqueue(job),
        ),
    },
    job_kinds=(IdentificationKind,),
    backed_up=BackedUp("identifications", partial(named_results, identifications)),
)
