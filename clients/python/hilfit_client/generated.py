"""Made from docs/openapi.json by clients/python/generate.py; do not edit, run ``make client``."""
# ruff: noqa: E501

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal, NotRequired, TypedDict, Unpack

from hilfit_client.transport import Transport

#: SHA-256 of the description that this was made from.
SOURCE_SHA256 = "0d95e8176f6406ef7ed492ab9a3c40d30aadf1c4ea9dc8cec9fc43912027e22d"


class AcquisitionWish(TypedDict):
    """Whether acquisition of a machine should run."""

    enabled: bool


class AlarmList(TypedDict):
    """A page of alarms."""

    items: list[AlarmResource]
    next: int | None


class AlarmResource(TypedDict):
    """An alarm: `raised` is when it came last, `count` how often before somebody acknowledged it."""

    acknowledged: bool
    acknowledged_by: str | None
    cleared: str | None
    count: int
    id: str
    kind: str
    machine: str | None
    raised: str
    severity: Literal["info", "warning", "critical"]
    shelve_reason: str | None
    shelved_by: str | None
    shelved_until: str | None
    state: Literal["active", "cleared"]
    text: str


class BackupList(TypedDict):
    """All backups, newest first."""

    items: list[BackupResource]
    next: NotRequired[None]


class BackupResource(TypedDict):
    """A backup; `kind` is daily or ordered. It is restored by `hilfit restore`, with the service stopped."""

    bytes: int
    created: str
    id: str
    kind: str
    missing: list[str]


class BusCheck(TypedDict):
    """Every device and every channel of a machine; `findings` are lines about what is not as it should be."""

    channels: list[CheckedChannel]
    cycles: int
    delays: list[CheckedDelay]
    devices: list[CheckedDevice]
    findings: list[str]
    machine: str
    notes: list[str]
    rate_hz: float
    seconds: float
    skipped: int
    utc: str
    worst_late_ms: float


class CalibrationList(TypedDict):
    """A page of calibrations."""

    items: list[CalibrationResource]
    next: int | None


class CalibrationResource(TypedDict):
    """A calibration; `errors` per joint and `overall` are the report's, before and after the loop."""

    activated: str | None
    approved_by: str | None
    created: str
    errors: dict[str, Any]
    history: list[StepResource]
    id: str
    identification: str
    label: str
    machine: str
    note: str
    overall: dict[str, Any]
    parameters: list[Parameter]
    proposed_by: str
    proposed_by_id: str
    state: Literal["proposed", "approved", "rejected", "active", "retired"]
    verdict: str


class CanBus(TypedDict):
    """A bus; `problems` are lines about channels, `left_out` counts signals that are not listed at all."""

    files: list[CanFile]
    left_out: int
    name: str
    problems: list[str]


class CanFile(TypedDict):
    """A file that a bus names: its digest (null if it is not there), or why it cannot be read."""

    error: str | None
    messages: int
    name: str
    sha256: str | None
    signals: int


class CanFileReplaced(TypedDict):
    """A file that was replaced."""

    name: str
    sha256: str


class CanSignal(TypedDict):
    """A signal of a DBC file: its value in `unit` is `factor * raw + offset`."""

    bits: int
    bus: str
    byte_order: Literal["little", "big"]
    channels: list[str]
    cycle_ms: int | None
    extended: bool
    factor: float | None
    file: str
    frame_id: int
    is_float: bool
    maximum: float | None
    message: str
    message_bytes: int
    minimum: float | None
    multiplexer: str | None
    multiplexer_values: list[int]
    offset: float | None
    pgn: int | None
    refusal: str | None
    selects: bool
    signal: str
    signed: bool
    source: dict[str, str | int] | None
    start_bit: int
    unit: str


class CanSignalList(TypedDict):
    """Buses of plain CAN or J1939 of a machine, and `found` signals, of which the first are listed."""

    buses: list[CanBus]
    found: int
    items: list[CanSignal]
    machine: str
    quantities: list[CanSignalQuantity]
    version: int


class CanSignalQuantity(TypedDict):
    """What a channel can measure, and whether it then names a joint."""

    name: str
    of_a_joint: bool


class ChannelStatistics(TypedDict):
    """One channel in the unit of the file; null where no value is finite."""

    maximum: float | None
    mean: float | None
    minimum: float | None
    missing: int
    quality: dict[str, int]
    std: float | None


class ChannelTrace(TypedDict):
    """One channel, in its unit, per moment."""

    doubtful: list[list[Any]]
    high: list[float | None] | None
    low: list[float | None]
    unit: str


class CheckedChannel(TypedDict):
    """A channel at rest, in its `unit`; null where nothing was measured."""

    age_ms: float | None
    bus: str
    device: str
    drift: float | None
    drift_std: float | None
    jitter_ms: float | None
    moved: bool
    name: str
    noise: float | None
    others: dict[str, int]
    raw: float | None
    share: float
    step: float | None
    unit: str
    value: float | None


class CheckedDelay(TypedDict):
    """By how much `bus` is behind `reference` (negative: ahead of it), with standard deviation, and who says so."""

    bus: str
    delay_ms: float
    reference: str
    std_ms: float
    told_by: list[DelayOfJoint]


class CheckedDevice(TypedDict):
    """A device: its state with a line that says more, what it says of itself, and where its values are."""

    bus: str
    detail: str
    device: str
    identity: dict[str, str]
    jitter_ms: float | None
    latency_ms: float | None
    mapping: str
    state: str


class CodeOrder(TypedDict):
    """For which role, and for which machines (null: all), a device is to be paired."""

    days: NotRequired[int | None]
    machines: NotRequired[list[str] | None]
    role: Literal["viewer", "operator", "engineer", "admin"]


class CodeResource(TypedDict):
    """A pairing code, its address for the device to be paired, and that address as a QR code (SVG)."""

    code: str
    expires: str
    machines: list[str] | None
    qr_svg: str
    role: Literal["viewer", "operator", "engineer", "admin"]
    url: str


class ComparisonResource(TypedDict):
    """Two calibrations side by side."""

    a: CalibrationResource
    b: CalibrationResource
    errors: dict[str, JointErrors]
    parameters: list[ShiftResource]


class Cut(TypedDict):
    """A part of a recording, s since its first row."""

    end: float
    label: NotRequired[str]
    start: float


class Decision(TypedDict):
    """Why."""

    note: NotRequired[str]


class DelayOfJoint(TypedDict):
    """What one joint's channels on both buses say: by their `kind` (`position` or `effort`), in ms."""

    delay_ms: float
    joint: str
    kind: str
    std_ms: float


class DeliveryList(TypedDict):
    """A page of deliveries."""

    items: list[DeliveryResource]
    next: int | None


class DeliveryResource(TypedDict):
    """A message on its way; `message` is what the receiver knows it by, `error` why the last try failed."""

    created: str
    ended: str | None
    error: str | None
    id: str
    message: str
    state: Literal["pending", "delivered", "given_up"]
    tries: int
    type: Literal["state", "result", "alarm", "test"]


class EntryList(TypedDict):
    """A page of the audit log, newest first."""

    items: list[EntryResource]
    next: int | None


class EntryResource(TypedDict):
    """An entry of the audit log; `hash` covers it and the hash of the entry before."""

    action: str
    detail: dict[str, Any]
    hash: str
    number: int
    principal: str
    subject: str
    time: str


class ExcitationList(TypedDict):
    """A page of excitations."""

    items: list[ExcitationResource]
    next: int | None


class ExcitationOrder(TypedDict):
    """What motion to design."""

    duration_s: NotRequired[float | None]
    joints: NotRequired[list[str] | None]
    label: NotRequired[str]
    machine: str
    max_flow_l_min: NotRequired[float | None]
    max_frequency_hz: NotRequired[float | None]
    max_pressure_bar: NotRequired[float | None]
    rods: NotRequired[Literal["pinned", "unpinned"]]
    seed: NotRequired[int]
    starts: NotRequired[int | None]
    use: NotRequired[float | None]


class ExcitationResource(TypedDict):
    """An excitation; what its design found is there once its job is done."""

    condition_number: NotRequired[float | None]
    created: str
    id: str
    job: str
    joints: NotRequired[list[str] | None]
    label: str
    limits: NotRequired[list[dict[str, Any]] | None]
    machine: str
    machine_version: int
    not_told: NotRequired[list[str] | None]
    options: dict[str, Any]
    rods: NotRequired[Literal["pinned", "unpinned"] | None]
    seconds: NotRequired[float | None]
    state: Literal["queued", "running", "done", "failed", "cancelled"]


class FaultOffer(TypedDict):
    """A fault that the simulated machine can have: its name, what it is of, and its keys of a fault file."""

    entry: dict[str, Any]
    fault: str
    target: str


class FaultWish(TypedDict):
    """Faults to begin, with the keys of a fault file (`hilfit/faults/1`); `at` counts from now."""

    faults: list[dict[str, Any]]


class Fleet(TypedDict):
    """All machines, the one nearest to its limit first; those that are not watched follow by name."""

    items: list[FleetMachine]


class FleetAlarms(TypedDict):
    """How many alarms are active, and how many, active or not, nobody acknowledged."""

    critical: NotRequired[int]
    info: NotRequired[int]
    waiting: NotRequired[int]
    warning: NotRequired[int]


class FleetCalibration(TypedDict):
    """The calibration in use: since when, and the error over all joints that it reached, in noise floors."""

    activated: str | None
    error: float | None
    id: str
    label: str


class FleetMachine(TypedDict):
    """A machine at a glance."""

    acquisition: str
    alarms: FleetAlarms
    calibration: FleetCalibration | None
    joint: MonitoredJoint | None
    monitor: Literal["off", "learning", "watching", "drift"]
    name: str
    reason: str | None
    version: int


class FoundEffect(TypedDict):
    """An effect that an identification added to the model; `joint` is null for one of the whole machine."""

    id: str
    joint: str | None
    title: str


class Health(TypedDict):
    """Answered when all is well."""

    status: Literal["ok"]


class History(TypedDict):
    """The time line of a machine, newest first."""

    complete: bool
    items: list[HistoryEvent]
    machine: str
    since: str


class HistoryEvent(TypedDict):
    """Something that happened to a machine."""

    by: NotRequired[str | None]
    effects: NotRequired[list[FoundEffect]]
    error: NotRequired[float | None]
    kind: Literal["file", "identification", "calibration", "drift", "alarm"]
    severity: NotRequired[Literal["info", "warning", "critical"] | None]
    subject: str
    text: str
    time: str
    until: NotRequired[str | None]
    what: str


class HolderList(TypedDict):
    """A page of devices or keys."""

    items: list[HolderResource]
    next: int | None


class HolderResource(TypedDict):
    """A paired device or an API key."""

    address: str | None
    created: str
    created_by: str
    expires: str | None
    id: str
    kind: Literal["device", "key"]
    machines: list[str] | None
    name: str
    role: Literal["viewer", "operator", "engineer", "admin"]
    seen: str | None
    streams: int


class IdentificationList(TypedDict):
    """A page of identifications."""

    items: list[IdentificationResource]
    next: int | None


class IdentificationOptions(TypedDict):
    """Choices of an identification (:class:`fitting.loop.session.Options`)."""

    bandwidth_hz: NotRequired[float | None]
    bootstrap: NotRequired[int]
    columns: NotRequired[None]
    covariance: NotRequired[Literal["hac", "bootstrap", "white"]]
    estimator: NotRequired[str]
    forgetting: NotRequired[float]
    loop: NotRequired[bool]
    prior: NotRequired[None]
    resample: NotRequired[bool]


class IdentificationOrder(TypedDict):
    """What to identify."""

    label: NotRequired[str]
    machine: str
    options: NotRequired[IdentificationOptions]
    recordings: list[RecordingChoice]


class IdentificationResource(TypedDict):
    """An identification; `verdict` and `overall` are there once its job is done."""

    created: str
    id: str
    job: str
    label: str
    machine: str
    machine_version: int
    options: dict[str, Any]
    overall: dict[str, Any] | None
    recordings: list[RecordingChoice]
    verdict: str | None


class JobList(TypedDict):
    """A page of jobs."""

    items: list[JobResource]
    next: int | None


class JobResource(TypedDict):
    """A job as it is now; `fraction` is 0 to 1 over all stages."""

    cancel_requested: bool
    created: str
    ended: str | None
    error: str | None
    expected_end: NotRequired[str | None]
    fraction: float
    id: str
    kind: str
    label: str
    stage: str | None
    stages: list[str]
    started: str | None
    state: Literal["queued", "running", "done", "failed", "cancelled"]
    subject: str
    text: str


class JointErrors(TypedDict):
    """Error of a joint on the validation motion, after each fit."""

    a: float | None
    b: float | None
    unit: str | None


class KeyOrder(TypedDict):
    """An API key for a program."""

    days: NotRequired[int | None]
    machines: NotRequired[list[str] | None]
    name: str
    role: Literal["viewer", "operator", "engineer", "admin"]


class LogLine(TypedDict):
    """A line of the log; `detail` is what it says beside time, level, logger and event."""

    detail: dict[str, Any]
    event: str
    level: str
    logger: str
    number: int
    time: str


class LogLines(TypedDict):
    """Lines, oldest first; `newest`: number of the newest line there is, to go on from."""

    items: list[LogLine]
    newest: int


class MachineCheck(TypedDict):
    """A machine file without fault: the machine's name, and the version that it would be (the current one as it is)."""

    name: str
    version: int


class MachineDetail(TypedDict):
    """A machine with its validated file and the state of its acquisition."""

    acquire: bool
    acquisition: dict[str, Any]
    created: str
    current: int
    machine: dict[str, Any]
    name: str
    sha256: str
    version: int
    versions: list[int]


class MachineFaults(TypedDict):
    """What can be broken, and what is: keys of a fault file, with `left_s` seconds until it is over."""

    offers: list[FaultOffer]
    running: list[dict[str, Any]]
    simulated: bool


class MachineList(TypedDict):
    """A page of machines; `next` is the cursor of the next page."""

    items: list[MachineSummary]
    next: int | None


class MachineSummary(TypedDict):
    """A machine: its current version, and whether it is acquired."""

    acquire: bool
    created: str
    current: int
    name: str
    sha256: str
    version: int


class MonitorResource(TypedDict):
    """The monitor of a machine; `reason` says why it is off, `delay_s` how late the residual is."""

    calibration: NotRequired[str | None]
    delay_s: NotRequired[float | None]
    joints: NotRequired[list[MonitoredJoint]]
    overload: NotRequired[OverloadNow | None]
    overload_delay_s: NotRequired[float | None]
    overload_joints: NotRequired[list[OverloadJoint]]
    payload: NotRequired[Payload | None]
    reason: NotRequired[str | None]
    since: NotRequired[str | None]
    state: Literal["off", "learning", "watching", "drift"]
    time: NotRequired[float | None]


class MonitoredJoint(TypedDict):
    """One joint's residual and its cumulative sums."""

    cusum: float
    false_alarms_per_year: float
    joint: str
    learnt: float
    residual: float | None
    statistic: str
    threshold: float
    unit: str


class NewKey(TypedDict):
    """An API key with its secret, which is shown this once."""

    address: str | None
    created: str
    created_by: str
    expires: str | None
    id: str
    key: str
    kind: Literal["device", "key"]
    machines: list[str] | None
    name: str
    role: Literal["viewer", "operator", "engineer", "admin"]
    seen: str | None
    streams: int


class NewWebhook(TypedDict):
    """A webhook and its secret (`whsec_...`), which is shown this once."""

    created: str
    created_by: str
    events: list[Literal["alarm", "result"]]
    id: str
    label: str
    secret: str
    url: str


class OverloadJoint(TypedDict):
    """How near a joint came to an overload within the last second."""

    joint: str
    residual: float
    share: float
    unit: str


class OverloadNow(TypedDict):
    """An overload that has not ended: where, measured minus predicted effort there, and that over its band."""

    joint: str
    on: bool
    residual: float
    score: float
    threshold: float
    time: float
    unit: str


class Paired(TypedDict):
    """The device's token: it is shown this once."""

    principal: PrincipalResource
    token: str


class Pairing(TypedDict):
    """The code, and what the device is to be called."""

    code: str
    name: str


class Parameter(TypedDict):
    """A parameter in the unit that it has in the report."""

    name: str
    std: float | None
    unit: str | None
    value: float | None


class Payload(TypedDict):
    """Mass at the tip beyond that of the calibration's recordings, kg, of the last ten seconds of motion."""

    mass: float
    std: float


class PrincipalResource(TypedDict):
    """Who asks; `machines` null: all of them."""

    approves_own: bool
    id: str
    kind: Literal["device", "key", "local", "service"]
    machines: list[str] | None
    name: str
    role: Literal["viewer", "operator", "engineer", "admin"]


class Problem(TypedDict):
    """A problem document: what went wrong with one request, and what to do."""

    code: str
    detail: str
    errors: NotRequired[list[dict[str, Any]] | None]
    instance: str
    status: int
    title: str
    type: str
    values: NotRequired[dict[str, str | int]]


class Proposal(TypedDict):
    """Propose an identification as a calibration; without a label it has the identification's."""

    identification: str
    label: NotRequired[str]


class RecalibrationResource(TypedDict):
    """A recalibration; its id is the `subject` of its job. What it has not come to is null."""

    calibration: str | None
    comparison: dict[str, Any] | None
    created: str
    id: str
    identification: str | None
    job: str
    label: str
    machine: str
    recordings: dict[str, str]
    schedule: str | None
    state: Literal["queued", "running", "done", "failed", "cancelled"]


class RecordedEventResource(TypedDict):
    """What happened to a device: `time` in s since the first row; `seconds` null for what lasted on at the end."""

    count: int
    device: str
    seconds: float | None
    text: str
    time: float | None
    what: str


class RecordingChoice(TypedDict):
    """A recording to identify from, by default in the role that it was recorded in."""

    id: str
    role: NotRequired[Literal["unloaded", "train", "repeat", "validate", "operation"] | None]


class RecordingList(TypedDict):
    """A page of recordings."""

    items: list[RecordingResource]
    next: int | None


class RecordingRemarks(TypedDict):
    """What is said beside a recording: its events, and what `hilfit check` finds in it."""

    events: list[RecordedEventResource]
    findings: list[dict[str, Any]]


class RecordingResource(TypedDict):
    """A recording; `statistics` count rows, gaps and what the acquisition lost while it ran."""

    bytes: int | None
    created: str
    ended: str | None
    error: str | None
    format: Literal["parquet", "csv"]
    id: str
    label: str
    machine: str
    machine_version: int
    origin: Literal["recorded", "uploaded"]
    role: str
    sha256: str | None
    state: Literal["recording", "sealed", "failed"]
    statistics: dict[str, Any]


class RecordingStart(TypedDict):
    """Start recording a machine that is being acquired; without `seconds` until it is stopped."""

    label: NotRequired[str]
    machine: str
    role: Literal["unloaded", "train", "repeat", "validate", "operation"]
    seconds: NotRequired[float | None]


class RecordingStatistics(TypedDict):
    """A recording's rows, its time in s, its gaps (steps of more than one and a half periods), and its channels."""

    channels: dict[str, ChannelStatistics]
    gaps: int
    rate_hz: float
    rows: int
    seconds: float


class ScheduleList(TypedDict):
    """A page of schedules."""

    items: list[ScheduleResource]
    next: int | None


class ScheduleResource(TypedDict):
    """A schedule; `next` is its next slot in UTC, `last` the last that had its turn."""

    activate: NotRequired[Literal["never", "if_better"]]
    created: str
    cron: str
    deadline_s: NotRequired[float]
    duration_s: NotRequired[float]
    enabled: NotRequired[bool]
    excitations: NotRequired[list[str]]
    id: str
    label: NotRequired[str]
    last: str | None
    machine: str
    motion: NotRequired[Literal["operation", "standard"]]
    next: str | None
    options: NotRequired[IdentificationOptions]
    timezone: NotRequired[str]


class ScheduleWish(TypedDict):
    """When and how a machine is recalibrated."""

    activate: NotRequired[Literal["never", "if_better"]]
    cron: str
    deadline_s: NotRequired[float]
    duration_s: NotRequired[float]
    enabled: NotRequired[bool]
    excitations: NotRequired[list[str]]
    label: NotRequired[str]
    machine: str
    motion: NotRequired[Literal["operation", "standard"]]
    options: NotRequired[IdentificationOptions]
    timezone: NotRequired[str]


class Sent(TypedDict):
    """The controller has the motion, and follows it after those that came before."""

    name: str


class Shelf(TypedDict):
    """How long an alarm is to be quiet, and why."""

    reason: str
    seconds: float


class ShiftResource(TypedDict):
    """A parameter in both; `sigmas` is how far b is from a in standard deviations of the difference."""

    a: float | None
    a_std: float | None
    b: float | None
    b_std: float | None
    name: str
    sigmas: float | None
    unit: str | None


class Signals(TypedDict):
    """Signals over time; moments are `moment_s` long, 0 for rows as they are."""

    channels: dict[str, ChannelTrace]
    end: float
    first_utc: float | None
    moment_s: float
    start: float
    time: list[float]


class SlotList(TypedDict):
    """The newest slots of a schedule, newest first."""

    items: list[SlotResource]


class SlotResource(TypedDict):
    """A slot in UTC; `coalesced`: it had its turn together with a later one."""

    calibration: str | None
    job: str | None
    note: str
    slot: str
    state: Literal["done", "failed", "missed", "coalesced", "running"]


class Spectrum(TypedDict):
    """Power spectral density of one channel, unit^2/Hz, over frequency in Hz; `seconds` of it without a gap."""

    channel: str
    density: list[float]
    frequency: list[float]
    seconds: float
    unit: str


class Status(TypedDict):
    """The service at a glance; a list need not be read again until its number in `revisions` moves."""

    acquisition: dict[str, dict[str, Any]]
    jobs: dict[str, int]
    revisions: dict[str, int]
    started: str
    version: str


class StepResource(TypedDict):
    """Who did what to a calibration, when."""

    action: Literal["proposed", "approved", "rejected", "activated", "retired"]
    by: str
    note: str
    time: str


class UpcomingSlots(TypedDict):
    """The next slots of a cron expression, in UTC; fewer where it ends."""

    slots: list[str]


class ValveAxis(TypedDict):
    """One axis in short."""

    delay: float
    edges: dict[str, float]
    effects: list[ValveEffect]
    error: float
    handed_out: Literal["model", "before", "static"]
    judged_on: Literal["train", "validate"]
    speeds: dict[str, float]
    verdict: Literal["nothing_missing", "effect_added", "ambiguous"]


class ValveEffect(TypedDict):
    """What the model of a valve lacked."""

    id: str
    probability: float


class ValveList(TypedDict):
    """A page of identifications of valves."""

    items: list[ValveResource]
    next: int | None


class ValveOptions(TypedDict):
    """Choices: `loop`: look for effects. `bandwidth_hz`: of the filter; 3 Hz, or a fifth of a slower rate."""

    bandwidth_hz: NotRequired[float | None]
    loop: NotRequired[bool]


class ValveOrder(TypedDict):
    """Whose valves to identify, from recordings with commands; those in the role `validate` are judged on."""

    label: NotRequired[str]
    machine: str
    options: NotRequired[ValveOptions]
    recordings: list[RecordingChoice]


class ValveResource(TypedDict):
    """An identification of valves; `axes` are there, by joint, once its job is done."""

    axes: dict[str, ValveAxis] | None
    created: str
    id: str
    job: str
    label: str
    machine: str
    machine_version: int
    options: dict[str, Any]
    recordings: list[RecordingChoice]


class VerificationResource(TypedDict):
    """Whether the log is as it was written."""

    entries: int
    first_broken: int | None
    intact: bool
    last_hash: str | None


class WebhookList(TypedDict):
    """A page of webhooks."""

    items: list[WebhookResource]
    next: int | None


class WebhookOrder(TypedDict):
    """Where messages of which types are delivered to; `url` has to be in the setting `webhook_places`."""

    events: NotRequired[list[Literal["alarm", "result"]]]
    label: NotRequired[str]
    url: str


class WebhookResource(TypedDict):
    """A webhook, without its secret."""

    created: str
    created_by: str
    events: list[Literal["alarm", "result"]]
    id: str
    label: str
    url: str


class WorkerList(TypedDict):
    """All that were ever heard of, by name."""

    items: list[WorkerResource]
    next: NotRequired[None]


class WorkerResource(TypedDict):
    """A process that runs jobs."""

    cores: int
    heard: str
    host: str
    id: str
    load: float
    silent: bool
    state: str
    version: str


class AccessApi:
    """What is below ``/access``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_devices(
        self,
        *,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> HolderList:
        """List paired devices."""
        answer: HolderList = self._transport.json(
            "GET",
            "/api/v1/access/devices",
            query={"limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def remove_device(self, id: str) -> None:
        """Unpair a device: its token is worth nothing from now on, and its streams are closed."""
        self._transport.nothing("DELETE", f"/api/v1/access/devices/{self._transport.quoted(id)}")

    def list_keys(
        self,
        *,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> HolderList:
        """List API keys."""
        answer: HolderList = self._transport.json(
            "GET",
            "/api/v1/access/keys",
            query={"limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def make_key(self, *, idempotency_key: str | None = None, **body: Unpack[KeyOrder]) -> NewKey:
        """Make an API key for a program; its secret is shown this once."""
        answer: NewKey = self._transport.json(
            "POST", "/api/v1/access/keys", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def remove_key(self, id: str) -> None:
        """Revoke an API key; its streams are closed."""
        self._transport.nothing("DELETE", f"/api/v1/access/keys/{self._transport.quoted(id)}")

    def get_key(self, id: str) -> HolderResource:
        """Read an API key, without its secret."""
        answer: HolderResource = self._transport.json("GET", f"/api/v1/access/keys/{self._transport.quoted(id)}")
        return answer

    def end_me(self) -> None:
        """End the session of whoever asks: its token is worth nothing from now on, and its streams are closed."""
        self._transport.nothing("DELETE", "/api/v1/access/me")

    def me(self) -> PrincipalResource:
        """Who asks."""
        answer: PrincipalResource = self._transport.json("GET", "/api/v1/access/me")
        return answer

    def pair(self, **body: Unpack[Pairing]) -> Paired:
        """Pair a device by a code that an admin made; the token is shown this once."""
        answer: Paired = self._transport.json("POST", "/api/v1/access/pair", json=dict(body))
        return answer

    def make_pairing_code(self, *, idempotency_key: str | None = None, **body: Unpack[CodeOrder]) -> CodeResource:
        """Make a code that pairs one device within a quarter of an hour; one `Idempotency-Key` makes one code."""
        answer: CodeResource = self._transport.json(
            "POST", "/api/v1/access/pairing-codes", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer


class AlarmsApi:
    """What is below ``/alarms``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_alarms(
        self,
        *,
        machine: str | None = None,
        state: Literal["active", "cleared"] | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> AlarmList:
        """List alarms, newest first; one of the service as a whole has no machine; `label` is looked for in the text."""
        answer: AlarmList = self._transport.json(
            "GET",
            "/api/v1/alarms",
            query={
                "machine": machine,
                "state": state,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def get(self, id: str) -> AlarmResource:
        """Read an alarm; its `ETag` is for changing it."""
        answer: AlarmResource = self._transport.json("GET", f"/api/v1/alarms/{self._transport.quoted(id)}")
        return answer

    def acknowledge(self, id: str, *, if_match: str | None = None, if_none_match: str | None = None) -> AlarmResource:
        """Say that somebody has seen it; the first who says so stays named."""
        answer: AlarmResource = self._transport.json(
            "POST",
            f"/api/v1/alarms/{self._transport.quoted(id)}/acknowledge",
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def shelve(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None, **body: Unpack[Shelf]
    ) -> AlarmResource:
        """Keep an alarm quiet for a while: it is tracked, but nobody is to be called."""
        answer: AlarmResource = self._transport.json(
            "POST",
            f"/api/v1/alarms/{self._transport.quoted(id)}/shelve",
            json=dict(body),
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def unshelve(self, id: str, *, if_match: str | None = None, if_none_match: str | None = None) -> AlarmResource:
        """Let a shelved alarm be heard again."""
        answer: AlarmResource = self._transport.json(
            "POST",
            f"/api/v1/alarms/{self._transport.quoted(id)}/unshelve",
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer


class AuditApi:
    """What is below ``/audit``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_entries(
        self,
        *,
        action: str | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> EntryList:
        """List the audit log, newest first; `label` is looked for in what it was done to."""
        answer: EntryList = self._transport.json(
            "GET",
            "/api/v1/audit",
            query={"action": action, "limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def verify(self) -> VerificationResource:
        """Compute the chain of hashes again: whether the log is as it was written."""
        answer: VerificationResource = self._transport.json("GET", "/api/v1/audit/verification")
        return answer


class BackupsApi:
    """What is below ``/backups``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_backups(self) -> BackupList:
        """List backups, newest first."""
        answer: BackupList = self._transport.json("GET", "/api/v1/backups")
        return answer

    def make(self) -> BackupResource:
        """Make a backup now."""
        answer: BackupResource = self._transport.json("POST", "/api/v1/backups")
        return answer


class CalibrationsApi:
    """What is below ``/calibrations``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_calibrations(
        self,
        *,
        machine: str | None = None,
        state: Literal["proposed", "approved", "rejected", "active", "retired"] | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> CalibrationList:
        """List calibrations, newest first."""
        answer: CalibrationList = self._transport.json(
            "GET",
            "/api/v1/calibrations",
            query={
                "machine": machine,
                "state": state,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def propose(self, **body: Unpack[Proposal]) -> CalibrationResource:
        """Propose an identification that is done; one that was proposed before is answered with 200 as it is."""
        answer: CalibrationResource = self._transport.json("POST", "/api/v1/calibrations", json=dict(body))
        return answer

    def compare(self, *, a: str, b: str) -> ComparisonResource:
        """Two calibrations of one machine: every parameter, how far it moved, and the errors per joint."""
        answer: ComparisonResource = self._transport.json("GET", "/api/v1/calibrations/compare", query={"a": a, "b": b})
        return answer

    def get(self, id: str) -> CalibrationResource:
        """Read a calibration; its `ETag` is for changing it."""
        answer: CalibrationResource = self._transport.json("GET", f"/api/v1/calibrations/{self._transport.quoted(id)}")
        return answer

    def activate(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None
    ) -> CalibrationResource:
        """Use an approved calibration; the one in use before is retired."""
        answer: CalibrationResource = self._transport.json(
            "POST",
            f"/api/v1/calibrations/{self._transport.quoted(id)}/activate",
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def approve(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None, **body: Unpack[Decision]
    ) -> CalibrationResource:
        """Approve a proposed calibration; whoever proposed it may only where the policy says so (`second_person`)."""
        answer: CalibrationResource = self._transport.json(
            "POST",
            f"/api/v1/calibrations/{self._transport.quoted(id)}/approve",
            json=dict(body),
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def deactivate(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None, **body: Unpack[Decision]
    ) -> CalibrationResource:
        """Take the calibration in use out of use: none is in use then, and the monitor rests. It can be activated again."""
        answer: CalibrationResource = self._transport.json(
            "POST",
            f"/api/v1/calibrations/{self._transport.quoted(id)}/deactivate",
            json=dict(body),
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def model(self, id: str) -> dict[str, Any]:
        """Download the fitted model (schema `hilfit/model/1`), with the calibration's id in its provenance."""
        answer: dict[str, Any] = self._transport.json(
            "GET", f"/api/v1/calibrations/{self._transport.quoted(id)}/model.json"
        )
        return answer

    def reject(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None, **body: Unpack[Decision]
    ) -> CalibrationResource:
        """Reject a calibration that is not in use and never was."""
        answer: CalibrationResource = self._transport.json(
            "POST",
            f"/api/v1/calibrations/{self._transport.quoted(id)}/reject",
            json=dict(body),
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer


class CanSignalsApi:
    """What is below ``/can-signals``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_signals(
        self, *, machine: str, bus: str | None = None, search: str | None = None, limit: int | None = None
    ) -> CanSignalList:
        """List the signals of a machine's buses of plain CAN or J1939, as their DBC files describe them."""
        answer: CanSignalList = self._transport.json(
            "GET", "/api/v1/can-signals", query={"machine": machine, "bus": bus, "search": search, "limit": limit}
        )
        return answer

    def file(self, *, machine: str, name: str) -> bytes:
        """Download a DBC file that a machine's file names."""
        return self._transport.content("GET", "/api/v1/can-signals/file", query={"machine": machine, "name": name})

    def upload(
        self, content: bytes, *, machine: str, name: str, if_match: str | None = None, if_none_match: str | None = None
    ) -> CanFileReplaced:
        """Upload a DBC file in the place of one that a machine's file names; acquisition goes on with the new one."""
        answer: CanFileReplaced = self._transport.json(
            "POST",
            "/api/v1/can-signals/upload",
            content=content,
            query={"machine": machine, "name": name},
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer


class EffectsApi:
    """What is below ``/effects``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_effects(self) -> dict[str, list[dict[str, Any]]]:
        """List effects."""
        answer: dict[str, list[dict[str, Any]]] = self._transport.json("GET", "/api/v1/effects")
        return answer

    def get(self, id: str) -> dict[str, Any]:
        """Read an effect."""
        answer: dict[str, Any] = self._transport.json("GET", f"/api/v1/effects/{self._transport.quoted(id)}")
        return answer


class EventsApi:
    """What is below ``/events``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def events(self) -> Iterator[dict[str, Any]]:
        """Follow the revision counters of `/status`: all of them at first, then each when it moves."""
        return self._transport.events("GET", "/api/v1/events")


class ExcitationsApi:
    """What is below ``/excitations``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_excitations(
        self,
        *,
        machine: str | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> ExcitationList:
        """List excitations, newest first."""
        answer: ExcitationList = self._transport.json(
            "GET",
            "/api/v1/excitations",
            query={
                "machine": machine,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def order(self, *, idempotency_key: str | None = None, **body: Unpack[ExcitationOrder]) -> ExcitationResource:
        """Order the design of a motion: its job is at `Location`; one `Idempotency-Key` makes one job."""
        answer: ExcitationResource = self._transport.json(
            "POST", "/api/v1/excitations", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def get(self, id: str) -> ExcitationResource:
        """Read an excitation."""
        answer: ExcitationResource = self._transport.json("GET", f"/api/v1/excitations/{self._transport.quoted(id)}")
        return answer

    def motion(self, id: str) -> str:
        """The motion file, for the arm's own controller."""
        return self._transport.text("GET", f"/api/v1/excitations/{self._transport.quoted(id)}/motion.csv")

    def send(self, id: str) -> Sent:
        """Hand the motion to the simulated machine's controller; 409 for a real machine, whose controller is its own."""
        answer: Sent = self._transport.json("POST", f"/api/v1/excitations/{self._transport.quoted(id)}/send")
        return answer


class FleetApi:
    """What is below ``/fleet``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def fleet(self) -> Fleet:
        """All machines with their residual against its limit, the calibration in use, and how many alarms there are."""
        answer: Fleet = self._transport.json("GET", "/api/v1/fleet")
        return answer


class IdentificationsApi:
    """What is below ``/identifications``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_identifications(
        self,
        *,
        machine: str | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> IdentificationList:
        """List identifications, newest first."""
        answer: IdentificationList = self._transport.json(
            "GET",
            "/api/v1/identifications",
            query={
                "machine": machine,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def order(
        self, *, idempotency_key: str | None = None, **body: Unpack[IdentificationOrder]
    ) -> IdentificationResource:
        """Order an identification: its job is at `Location`; one `Idempotency-Key` makes one job."""
        answer: IdentificationResource = self._transport.json(
            "POST", "/api/v1/identifications", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def get(self, id: str) -> IdentificationResource:
        """Read an identification."""
        answer: IdentificationResource = self._transport.json(
            "GET", f"/api/v1/identifications/{self._transport.quoted(id)}"
        )
        return answer

    def next_experiment(self, id: str) -> str:
        """The motion that would tell apart what these recordings could not (a motion file); 404 if none was designed."""
        return self._transport.text("GET", f"/api/v1/identifications/{self._transport.quoted(id)}/next-experiment.csv")

    def report_page(self, id: str, *, language: Literal["en", "de"] | None = None) -> str:
        """The result as a self-contained page."""
        return self._transport.text(
            "GET", f"/api/v1/identifications/{self._transport.quoted(id)}/report.html", query={"language": language}
        )

    def report(self, id: str) -> dict[str, Any]:
        """The result (schema `hilfit/report/1`)."""
        answer: dict[str, Any] = self._transport.json(
            "GET", f"/api/v1/identifications/{self._transport.quoted(id)}/report.json"
        )
        return answer


class JobsApi:
    """What is below ``/jobs``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_jobs(
        self,
        *,
        state: Literal["queued", "running", "done", "failed", "cancelled"] | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> JobList:
        """List jobs, newest first; a page may be short where jobs of other machines are left out."""
        answer: JobList = self._transport.json(
            "GET",
            "/api/v1/jobs",
            query={"state": state, "limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def get(self, id: str) -> JobResource:
        """Read a job."""
        answer: JobResource = self._transport.json("GET", f"/api/v1/jobs/{self._transport.quoted(id)}")
        return answer

    def cancel(self, id: str) -> JobResource:
        """Ask a job to stop; one that has ended stays as it is."""
        answer: JobResource = self._transport.json("POST", f"/api/v1/jobs/{self._transport.quoted(id)}/cancel")
        return answer

    def events(
        self, id: str, *, after: int | None = None, last_event_id: str | None = None
    ) -> Iterator[dict[str, Any]]:
        """Follow a job as server-sent events; the stream ends with the job. Each event's `id` is its number."""
        return self._transport.events(
            "GET",
            f"/api/v1/jobs/{self._transport.quoted(id)}/events",
            query={"after": after},
            headers={"last-event-id": last_event_id},
        )


class LiveApi:
    """What is below ``/live``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def snapshot(self, *, machine: str | None = None) -> dict[str, dict[str, Any]]:
        """The newest values, with quality and age, of one machine or of all, by machine name."""
        answer: dict[str, dict[str, Any]] = self._transport.json("GET", "/api/v1/live", query={"machine": machine})
        return answer


class LogsApi:
    """What is below ``/logs``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def log_lines(
        self,
        *,
        after: int | None = None,
        level: Literal["debug", "info", "warning", "error", "critical"] | None = None,
        containing: str | None = None,
        limit: int | None = None,
    ) -> LogLines:
        """The newest lines of the service's log since its start, oldest first; workers have logs of their own."""
        answer: LogLines = self._transport.json(
            "GET", "/api/v1/logs", query={"after": after, "level": level, "containing": containing, "limit": limit}
        )
        return answer


class MachinesApi:
    """What is below ``/machines``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_machines(
        self,
        *,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> MachineList:
        """List machines; `label` is looked for in their names, and a machine's time is that of its current version."""
        answer: MachineList = self._transport.json(
            "GET",
            "/api/v1/machines",
            query={"limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def upload(
        self, content: bytes, *, if_match: str | None = None, if_none_match: str | None = None
    ) -> MachineSummary:
        """Upload a machine file: a new machine or a new version (200 if it is the current version already)."""
        answer: MachineSummary = self._transport.json(
            "POST", "/api/v1/machines", content=content, headers={"if-match": if_match, "if-none-match": if_none_match}
        )
        return answer

    def check(self, content: bytes) -> MachineCheck:
        """Check a machine file as an upload of it would; nothing is stored."""
        answer: MachineCheck = self._transport.json("POST", "/api/v1/machines/check", content=content)
        return answer

    def get(self, name: str, *, version: int | None = None) -> MachineDetail:
        """Read a machine: its file, validated, as JSON, and the state of its acquisition."""
        answer: MachineDetail = self._transport.json(
            "GET", f"/api/v1/machines/{self._transport.quoted(name)}", query={"version": version}
        )
        return answer

    def acquisition(self, name: str, **body: Unpack[AcquisitionWish]) -> MachineDetail:
        """Start or stop acquiring a machine; it stays so over restarts."""
        answer: MachineDetail = self._transport.json(
            "PUT", f"/api/v1/machines/{self._transport.quoted(name)}/acquisition", json=dict(body)
        )
        return answer

    def bus_check(self, name: str, *, seconds: float | None = None, depressurised: bool | None = None) -> BusCheck:
        """Check the buses of an acquired machine by its newest frames: identity, mapping, latency, noise, zero, drift."""
        answer: BusCheck = self._transport.json(
            "GET",
            f"/api/v1/machines/{self._transport.quoted(name)}/bus-check",
            query={"seconds": seconds, "depressurised": depressurised},
        )
        return answer

    def roll_back(self, name: str) -> CalibrationResource:
        """Use the calibration again that was in use before the active one."""
        answer: CalibrationResource = self._transport.json(
            "POST", f"/api/v1/machines/{self._transport.quoted(name)}/calibrations/rollback"
        )
        return answer

    def faults(self, name: str) -> MachineFaults:
        """What can be broken in a simulated machine, and what is broken now."""
        answer: MachineFaults = self._transport.json("GET", f"/api/v1/machines/{self._transport.quoted(name)}/faults")
        return answer

    def begin(self, name: str, **body: Unpack[FaultWish]) -> MachineFaults:
        """Let faults begin in the simulated machine; each ends by itself (409: this machine is not simulated)."""
        answer: MachineFaults = self._transport.json(
            "POST", f"/api/v1/machines/{self._transport.quoted(name)}/faults", json=dict(body)
        )
        return answer

    def file(self, name: str, *, version: int | None = None) -> bytes:
        """Read a machine file as it was uploaded."""
        return self._transport.content(
            "GET", f"/api/v1/machines/{self._transport.quoted(name)}/file", query={"version": version}
        )

    def history(self, name: str, *, days: int | None = None) -> History:
        """Calibrations, identifications with their effects, drifts, alarms and versions of a machine as one time line."""
        answer: History = self._transport.json(
            "GET", f"/api/v1/machines/{self._transport.quoted(name)}/history", query={"days": days}
        )
        return answer

    def monitor(self, name: str) -> MonitorResource:
        """Whether a machine still does what its active calibration says, joint by joint."""
        answer: MonitorResource = self._transport.json(
            "GET", f"/api/v1/machines/{self._transport.quoted(name)}/monitor"
        )
        return answer

    def signals(
        self,
        name: str,
        *,
        seconds: float | None = None,
        end: float | None = None,
        moments: int | None = None,
        channel: list[str] | None = None,
    ) -> Signals:
        """What a machine's channels did in the last hours, as far back as eight and as the start of the service."""
        answer: Signals = self._transport.json(
            "GET",
            f"/api/v1/machines/{self._transport.quoted(name)}/signals",
            query={"seconds": seconds, "end": end, "moments": moments, "channel": channel},
        )
        return answer


class RecalibrationsApi:
    """What is below ``/recalibrations``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def get(self, id: str) -> RecalibrationResource:
        """Read a recalibration, with the table of errors before and after."""
        answer: RecalibrationResource = self._transport.json(
            "GET", f"/api/v1/recalibrations/{self._transport.quoted(id)}"
        )
        return answer


class RecordingsApi:
    """What is below ``/recordings``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_recordings(
        self,
        *,
        machine: str | None = None,
        role: Literal["unloaded", "train", "repeat", "validate", "operation"] | None = None,
        state: Literal["recording", "sealed", "failed"] | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> RecordingList:
        """List recordings, newest first."""
        answer: RecordingList = self._transport.json(
            "GET",
            "/api/v1/recordings",
            query={
                "machine": machine,
                "role": role,
                "state": state,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def start(self, *, idempotency_key: str | None = None, **body: Unpack[RecordingStart]) -> RecordingResource:
        """Start recording a machine that is being acquired; one `Idempotency-Key` starts one recording."""
        answer: RecordingResource = self._transport.json(
            "POST", "/api/v1/recordings", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def upload(
        self,
        content: bytes,
        *,
        machine: str,
        role: Literal["unloaded", "train", "repeat", "validate", "operation"],
        name: str,
        columns: str | None = None,
        resample: bool | None = None,
    ) -> RecordingResource:
        """Upload a recording; one that `hilfit identify` would refuse is refused here."""
        answer: RecordingResource = self._transport.json(
            "POST",
            "/api/v1/recordings/upload",
            content=content,
            query={"machine": machine, "role": role, "name": name, "columns": columns, "resample": resample},
        )
        return answer

    def delete(self, id: str) -> None:
        """Delete a recording; one that an identification was made of has to stay."""
        self._transport.nothing("DELETE", f"/api/v1/recordings/{self._transport.quoted(id)}")

    def get(self, id: str) -> RecordingResource:
        """Read a recording; while it is being recorded its statistics are live."""
        answer: RecordingResource = self._transport.json("GET", f"/api/v1/recordings/{self._transport.quoted(id)}")
        return answer

    def cut(self, id: str, **body: Unpack[Cut]) -> RecordingResource:
        """Store a part of a sealed recording as a recording of its own; the whole one stays."""
        answer: RecordingResource = self._transport.json(
            "POST", f"/api/v1/recordings/{self._transport.quoted(id)}/cut", json=dict(body)
        )
        return answer

    def data(self, id: str, *, format: Literal["parquet", "csv", "mdf4", "mcap"] | None = None) -> bytes:
        """Download a recording, by default in the form in which it is kept."""
        return self._transport.content(
            "GET", f"/api/v1/recordings/{self._transport.quoted(id)}/data", query={"format": format}
        )

    def remarks(self, id: str) -> RecordingRemarks:
        """Events of a sealed recording, and what the checks find in it."""
        answer: RecordingRemarks = self._transport.json(
            "GET", f"/api/v1/recordings/{self._transport.quoted(id)}/remarks"
        )
        return answer

    def recorded(
        self,
        id: str,
        *,
        start: float | None = None,
        end: float | None = None,
        moments: int | None = None,
        channel: list[str] | None = None,
    ) -> Signals:
        """What the channels of a sealed recording did: the smallest and largest value of each moment."""
        answer: Signals = self._transport.json(
            "GET",
            f"/api/v1/recordings/{self._transport.quoted(id)}/signals",
            query={"start": start, "end": end, "moments": moments, "channel": channel},
        )
        return answer

    def spectrum(self, id: str, *, channel: str, start: float | None = None, end: float | None = None) -> Spectrum:
        """Power spectral density of one channel of a sealed recording, over its longest part without a gap."""
        answer: Spectrum = self._transport.json(
            "GET",
            f"/api/v1/recordings/{self._transport.quoted(id)}/spectrum",
            query={"channel": channel, "start": start, "end": end},
        )
        return answer

    def statistics(self, id: str) -> RecordingStatistics:
        """What a sealed recording holds, channel by channel."""
        answer: RecordingStatistics = self._transport.json(
            "GET", f"/api/v1/recordings/{self._transport.quoted(id)}/statistics"
        )
        return answer

    def stop(self, id: str) -> RecordingResource:
        """Stop a recording and seal its file."""
        answer: RecordingResource = self._transport.json(
            "POST", f"/api/v1/recordings/{self._transport.quoted(id)}/stop"
        )
        return answer


class SchedulesApi:
    """What is below ``/schedules``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_schedules(
        self,
        *,
        machine: str | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> ScheduleList:
        """List schedules, newest first."""
        answer: ScheduleList = self._transport.json(
            "GET",
            "/api/v1/schedules",
            query={
                "machine": machine,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def create(self, *, idempotency_key: str | None = None, **body: Unpack[ScheduleWish]) -> ScheduleResource:
        """Make a schedule; its first slot is the next one from now. One `Idempotency-Key` makes one schedule."""
        answer: ScheduleResource = self._transport.json(
            "POST", "/api/v1/schedules", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def upcoming(self, *, cron: str, timezone: str | None = None) -> UpcomingSlots:
        """When a schedule with this expression would run next; it is refused where a schedule with it would be."""
        answer: UpcomingSlots = self._transport.json(
            "GET", "/api/v1/schedules/upcoming", query={"cron": cron, "timezone": timezone}
        )
        return answer

    def delete(self, id: str, *, if_match: str | None = None, if_none_match: str | None = None) -> None:
        """Delete a schedule; its jobs and calibrations stay."""
        self._transport.nothing(
            "DELETE",
            f"/api/v1/schedules/{self._transport.quoted(id)}",
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )

    def get(self, id: str) -> ScheduleResource:
        """Read a schedule; its `ETag` is for changing it."""
        answer: ScheduleResource = self._transport.json("GET", f"/api/v1/schedules/{self._transport.quoted(id)}")
        return answer

    def change(
        self, id: str, *, if_match: str | None = None, if_none_match: str | None = None, **body: Unpack[ScheduleWish]
    ) -> ScheduleResource:
        """Change a schedule; slots before now that had no turn are forgotten."""
        answer: ScheduleResource = self._transport.json(
            "PUT",
            f"/api/v1/schedules/{self._transport.quoted(id)}",
            json=dict(body),
            headers={"if-match": if_match, "if-none-match": if_none_match},
        )
        return answer

    def run(self, id: str) -> JobResource:
        """Recalibrate now, whatever the clock says; its job is at `Location`."""
        answer: JobResource = self._transport.json("POST", f"/api/v1/schedules/{self._transport.quoted(id)}/run")
        return answer

    def list_slots(self, id: str, *, limit: int | None = None) -> SlotList:
        """The newest slots that had their turn, newest first."""
        answer: SlotList = self._transport.json(
            "GET", f"/api/v1/schedules/{self._transport.quoted(id)}/slots", query={"limit": limit}
        )
        return answer


class StatusApi:
    """What is below ``/status``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def status(self) -> Status:
        """Revision counters, jobs and acquisition."""
        answer: Status = self._transport.json("GET", "/api/v1/status")
        return answer


class ValvesApi:
    """What is below ``/valves``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_valves(
        self,
        *,
        machine: str | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> ValveList:
        """List identifications of valves, newest first."""
        answer: ValveList = self._transport.json(
            "GET",
            "/api/v1/valves",
            query={
                "machine": machine,
                "limit": limit,
                "cursor": cursor,
                "since": since,
                "until": until,
                "label": label,
            },
        )
        return answer

    def order(self, *, idempotency_key: str | None = None, **body: Unpack[ValveOrder]) -> ValveResource:
        """Order an identification of valves: its job is at `Location`; one `Idempotency-Key` makes one job."""
        answer: ValveResource = self._transport.json(
            "POST", "/api/v1/valves", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def get(self, id: str) -> ValveResource:
        """Read an identification of valves."""
        answer: ValveResource = self._transport.json("GET", f"/api/v1/valves/{self._transport.quoted(id)}")
        return answer

    def inverse(self, id: str, *, format: Literal["c", "csv", "python", "st"] | None = None) -> bytes:
        """What a controller is told: of each axis the command for a speed, as source; 404 if no valve moved its axis."""
        return self._transport.content(
            "GET", f"/api/v1/valves/{self._transport.quoted(id)}/inverse.zip", query={"format": format}
        )

    def report(self, id: str) -> dict[str, Any]:
        """The result (schema `hilfit/valve/1`)."""
        answer: dict[str, Any] = self._transport.json("GET", f"/api/v1/valves/{self._transport.quoted(id)}/valve.json")
        return answer


class WebhooksApi:
    """What is below ``/webhooks``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_webhooks(
        self,
        *,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> WebhookList:
        """List webhooks, newest first."""
        answer: WebhookList = self._transport.json(
            "GET",
            "/api/v1/webhooks",
            query={"limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def add_webhook(self, *, idempotency_key: str | None = None, **body: Unpack[WebhookOrder]) -> NewWebhook:
        """Add a webhook; its secret is shown this once. Its address has to be in the setting `webhook_places`."""
        answer: NewWebhook = self._transport.json(
            "POST", "/api/v1/webhooks", json=dict(body), headers={"idempotency-key": idempotency_key}
        )
        return answer

    def remove_webhook(self, id: str) -> None:
        """Remove a webhook and what is known of its deliveries; what is on its way is tried no more."""
        self._transport.nothing("DELETE", f"/api/v1/webhooks/{self._transport.quoted(id)}")

    def get_webhook(self, id: str) -> WebhookResource:
        """Read a webhook, without its secret."""
        answer: WebhookResource = self._transport.json("GET", f"/api/v1/webhooks/{self._transport.quoted(id)}")
        return answer

    def list_deliveries(
        self,
        id: str,
        *,
        state: Literal["pending", "delivered", "given_up"] | None = None,
        limit: int | None = None,
        cursor: int | None = None,
        since: str | None = None,
        until: str | None = None,
        label: str | None = None,
    ) -> DeliveryList:
        """List messages to a webhook, newest first: on their way, delivered (the last 500), given up (all)."""
        answer: DeliveryList = self._transport.json(
            "GET",
            f"/api/v1/webhooks/{self._transport.quoted(id)}/deliveries",
            query={"state": state, "limit": limit, "cursor": cursor, "since": since, "until": until, "label": label},
        )
        return answer

    def test_webhook(self, id: str) -> DeliveryResource:
        """Send a message of type `test`; what becomes of it is in the list at `Location`."""
        answer: DeliveryResource = self._transport.json("POST", f"/api/v1/webhooks/{self._transport.quoted(id)}/test")
        return answer


class WorkersApi:
    """What is below ``/workers``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def list_workers(self) -> WorkerList:
        """List the processes that run jobs; none where the service is alone."""
        answer: WorkerList = self._transport.json("GET", "/api/v1/workers")
        return answer


class HealthzApi:
    """What is below ``/healthz``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def healthz(self) -> Health:
        """Whether requests can be served: the store can be read, and the data directory be written."""
        answer: Health = self._transport.json("GET", "/healthz")
        return answer


class LivezApi:
    """What is below ``/livez``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def livez(self) -> Health:
        """Whether the process answers: if not, restart it."""
        answer: Health = self._transport.json("GET", "/livez")
        return answer


class MetricsApi:
    """What is below ``/metrics``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def read_metrics(self) -> str:
        """What is counted, for Prometheus."""
        return self._transport.text("GET", "/metrics")


class ReadyzApi:
    """What is below ``/readyz``."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport

    def readyz(self) -> Health:
        """Whether requests can be served: the store can be read, and the data directory be written."""
        answer: Health = self._transport.json("GET", "/readyz")
        return answer


class Api:
    """All resources of a service."""

    def __init__(self, transport: Transport) -> None:
        self.transport = transport
        self.access = AccessApi(transport)
        self.alarms = AlarmsApi(transport)
        self.audit = AuditApi(transport)
        self.backups = BackupsApi(transport)
        self.calibrations = CalibrationsApi(transport)
        self.can_signals = CanSignalsApi(transport)
        self.effects = EffectsApi(transport)
        self.events = EventsApi(transport)
        self.excitations = ExcitationsApi(transport)
        self.fleet = FleetApi(transport)
        self.identifications = IdentificationsApi(transport)
        self.jobs = JobsApi(transport)
        self.live = LiveApi(transport)
        self.logs = LogsApi(transport)
        self.machines = MachinesApi(transport)
        self.recalibrations = RecalibrationsApi(transport)
        self.recordings = RecordingsApi(transport)
        self.schedules = SchedulesApi(transport)
        self.status = StatusApi(transport)
        self.valves = ValvesApi(transport)
        self.webhooks = WebhooksApi(transport)
        self.workers = WorkersApi(transport)
        self.healthz = HealthzApi(transport)
        self.livez = LivezApi(transport)
        self.metrics = MetricsApi(transport)
        self.readyz = ReadyzApi(transport)
