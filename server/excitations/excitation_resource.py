"""The resource ``excitations``: motions that are designed for a machine."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from server.excitations.excitation_job import PROGRAM, ExcitationKind
from server.excitations.excitation_routes import router
from server.excitations.excitation_store import Excitation, Excitations
from server.excitations.motion_delivery import MotionDelivery
from server.jobs.job_places import named_results
from server.machines.machine_desk import MachineDesk
from server.platform.database.engine import Database
from server.platform.files import DataDirectory
from server.platform.parts import PartName, Parts
from server.platform.resource import BackedUp, Resource

DESIGN: PartName[Sequence[str]] = PartName("the program that designs motions")


def _delivery(parts: Parts) -> MotionDelivery:
    desk = parts[MachineDesk]
    return MotionDelivery(parts[DataDirectory], parts[Excitations], parts[ExcitationKind], lambda: desk.simulated)


EXCITATIONS = Resource(
    name="excitations",
    routers=(router,),
    tables=(Excitation.table,),
    of_a_machine={"excitations": Excitation.table},
    kept={"/excitations": ("excitations", "jobs")},
    provides={
        DESIGN: lambda parts: PROGRAM,
        Excitations: lambda parts: Excitations(parts[Database]),
        ExcitationKind: lambda parts: ExcitationKind(parts[Database], parts[DataDirectory], parts[DESIGN]),
        MotionDelivery: _delivery,
    },
    job_kinds=(ExcitationKind,),
    backed_up=BackedUp("excitations", partial(named_results, Excitation.table)),
)
