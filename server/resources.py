"""What the REST interface takes and gives; the only pydantic models of the service."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from server.access.names import MachineName, RecordingId
from server.store import Identification, Job, MachineRow, Page, RecordingRow

Role = Literal["unloaded", "train", "repeat", "validate", "operation"]
#: ``true`` or ``false``, not 0, "no" or what else Python takes for one.
Flag = Annotated[bool, Field(strict=True)]
Label = Annotated[str, Field(max_length=200)]


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid")


class MachineSummary(BaseModel):
    """A machine: its current version, and whether it is acquired."""

    name: str
    version: int
    current: int
    sha256: str
    created: str
    acquire: bool

    @classmethod
    def of(cls, row: MachineRow) -> MachineSummary:
        """From the store."""
        return cls(**row.__dict__)


class MachineCheck(BaseModel):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(MachineSummary):
    """A machine with its validated file and the state of its acquisition."""

    versions: list[int]
    machine: dict[str, Any]
    acquisition: dict[str, Any]


class MachineList(BaseModel):
    """A page of machines; ``next`` is the cursor of the next page."""

    items: list[MachineSummary]
    next: int | None

    @classmethod
    def of(cls, page: Page[MachineRow]) -> MachineList:
        """From the store."""
        return cls(items=[MachineSummary.of(row) for row in page.items], next=page.next)


class AcquisitionWish(_Body):
    """Whether acquisition of a machine should run."""

    enabled: Flag


class RecordingStart(_Body):
    """Start recording a machine that is being acquired; without ``seconds`` until it is stopped."""

    machine: MachineName
    role: Role
    label: Label = ""
    seconds: Annotated[float, Field(gt=0, le=86400)] | None = None


class RecordingResource(BaseModel):
    """A recording; ``statistics`` count rows, gaps and what the acquisition lost while it ran."""

    id: str
    machine: str
    machine_version: int
    role: str
    label: str
    state: Literal["recording", "sealed", "failed"]
    origin: Literal["recorded", "uploaded"]
    format: Literal["parquet", "csv"]
    created: str
    ended: str | None
    bytes: int | None
    sha256: str | None
    statistics: dict[str, Any]
    error: str | None

    @classmethod
    def of(cls, row: RecordingRow) -> RecordingResource:
        """From the store."""
        return cls(**row.__dict__)


class RecordingList(BaseModel):
    """A page of recordings."""

    items: list[RecordingResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[RecordingRow]) -> RecordingList:
        """From the store."""
        return cls(items=[RecordingResource.of(row) for row in page.items], next=page.next)


class RecordingChoice(_Body):
    """A recording to identify from, by default in the role that it was recorded in."""

    id: RecordingId
    role: Role | None = None


class IdentificationOptions(_Body):
    """Choices of an identification (:class:`fitting.session.Options`).

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


class IdentificationOrder(_Body):
    """What to identify."""

    machine: MachineName
    recordings: Annotated[list[RecordingChoice], Field(min_length=1, max_length=200)]
    options: IdentificationOptions = IdentificationOptions()
    label: Label = ""


class IdentificationResource(BaseModel):
    """An identification; ``verdict`` and ``overall`` are there once its job is done."""

    id: str
    job: str
    machine: str
    machine_version: int
    label: str
    recordings: list[RecordingChoice]
    options: dict[str, Any]
    created: str
    verdict: str | None
    overall: dict[str, Any] | None

    @classmethod
    def of(cls, value: Identification) -> IdentificationResource:
        """From the store."""
        chosen = [RecordingChoice.model_validate({"id": id, "role": role}) for id, role in value.recordings]
        return cls(**{**value.__dict__, "recordings": chosen})


class IdentificationList(BaseModel):
    """A page of identifications."""

    items: list[IdentificationResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[Identification]) -> IdentificationList:
        """From the store."""
        return cls(items=[IdentificationResource.of(value) for value in page.items], next=page.next)


class JobResource(BaseModel):
    """A job as it is now; ``fraction`` is 0 to 1 over all stages."""

    id: str
    kind: str
    label: str
    subject: str
    stages: list[str]
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    stage: str | None
    fraction: float
    text: str
    error: str | None
    cancel_requested: bool
    created: str
    started: str | None
    ended: str | None

    @classmethod
    def of(cls, job: Job) -> JobResource:
        """From the store."""
        values = {key: value for key, value in job.__dict__.items() if key != "place"}
        return cls(**{**values, "stages": list(job.stages)})


class JobList(BaseModel):
    """A page of jobs."""

    items: list[JobResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[Job]) -> JobList:
        """From the store."""
        return cls(items=[JobResource.of(job) for job in page.items], next=page.next)


class Status(BaseModel):
    """The service at a glance; a list need not be read again until its number in ``revisions`` moves."""

    version: str
    started: str
    revisions: dict[str, int]
    jobs: dict[str, int]
    acquisition: dict[str, dict[str, Any]]


class Health(BaseModel):
    """Answered when all is well."""

    status: Literal["ok"]
