"""``/machines/{name}/faults``: what breaks in the simulated machine, for training; only with ``serve --simulate``."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from server.machines.machine_desk import MachineDesk
from server.machines.machine_store import Machines
from server.machines.simulation import Simulation
from server.platform.authorization.guard import TypedRoute, require
from server.platform.errors import ConflictError
from server.platform.http.route_parameters import ServiceDep, problems
from server.platform.resource import PartName
from server.platform.service import Service


class FaultOffer(BaseModel):
    """A fault that the simulated machine can have: its name, what it is of, and its keys of a fault file."""

    fault: str
    target: str
    entry: dict[str, Any]


class MachineFaults(BaseModel):
    """What can be broken, and what is: keys of a fault file, with ``left_s`` seconds until it is over.

    ``simulated`` is false for a machine of this world, which has no offers.
    """

    simulated: bool
    offers: list[FaultOffer]
    running: list[dict[str, Any]]


class FaultWish(
    BaseModel,
    json_schema_extra={
        "examples": [{"faults": [{"at": 0, "for": 5, "fault": "node_death", "bus": "can", "node": 31}]}]
    },
):
    """Faults to begin, with the keys of a fault file (``hilfit/faults/1``); ``at`` counts from now.

    ``{"faults": [{"at": 0, "for": 5, "fault": "node_death", "bus": "can", "node": 31}]}``
    """

    model_config = ConfigDict(extra="forbid")

    faults: Annotated[list[dict[str, Any]], Field(min_length=1, max_length=20)]


router = APIRouter(prefix="/machines", tags=["machines"], route_class=TypedRoute)


#: The simulated machine; None without ``--simulate``.
BREAKABLE: PartName[Simulation | None] = PartName("what takes orders for faults")


@router.get("/{name}/faults", responses=problems(404, 422, 503), dependencies=[require("read")])
def faults(name: str, service: ServiceDep) -> MachineFaults:
    """List what can be broken in a simulated machine, and what is broken now."""
    simulated = _simulated(name, service)
    if simulated is None:
        return MachineFaults(simulated=False, offers=[], running=[])
    offers = [FaultOffer(**offer) for offer in simulated.order("offers")]
    return MachineFaults(simulated=True, offers=offers, running=simulated.order("running"))


@router.post(
    "/{name}/faults", status_code=202, responses=problems(404, 409, 422, 503), dependencies=[require("operate")]
)
def begin(name: str, wish: FaultWish, service: ServiceDep) -> MachineFaults:
    """Let faults begin in the simulated machine; each ends by itself (409: this machine is not simulated)."""
    simulated = _simulated(name, service)
    if simulated is None:
        raise ConflictError("server.machine_not_simulated_here", name=name)
    return MachineFaults(simulated=True, offers=[], running=simulated.order("begin", faults=wish.faults))


def _simulated(name: str, service: Service) -> Simulation | None:
    service[Machines].get(name)
    return service[BREAKABLE] if service[MachineDesk].simulated == name else None
