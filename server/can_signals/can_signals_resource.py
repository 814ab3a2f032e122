"""The resource ``can_signals``: what the DBC files of machines offer, and these files."""

from __future__ import annotations

import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse

from daq.machine.can_database import SUFFIXES
from daq.messages import with_messages
from daq.whole_files import digest_of, write_whole
from server.can_signals.can_signals_schemas import (
    CanBus,
    CanFileReplaced,
    CanSignal,
    CanSignalList,
    CanSignalQuantity,
    matching,
)
from server.machines.acquisition import Acquisition
from server.machines.machine_desk import BEING_RECORDED
from server.machines.machine_store import MachineRow, Machines
from server.machines.machine_uploads import MachineReader
from server.platform.authorization.guard import PrincipalDep, TypedRoute, require
from server.platform.errors import (
    ConflictError,
    InvalidError,
    NotFoundError,
    PreconditionError,
    UnavailableError,
    UnsupportedFormatError,
)
from server.platform.files import DataDirectory, receive
from server.platform.http.route_parameters import (
    BYTES,
    NONE_YET,
    KnownTags,
    Limit,
    OneMachine,
    ServiceDep,
    Tags,
    problems,
    sends,
    takes,
)
from server.platform.processes.file_children import FileChildren, refusal
from server.platform.resource import Resource

#: Seconds that the child has, when it has to share its core with everybody.
READING_S = 180.0
#: Machines whose signals are kept.
KEPT = 8
_Key = tuple[Path, tuple[tuple[str, int, int], ...]]


@dataclass(eq=False)
class SignalFiles:
    """DBC files of machines.

    Attributes
    ----------
    recorded : id of the recording that is being made of a machine, None without one
    """

    files: DataDirectory
    machines: Machines
    reader: MachineReader
    acquisition: Acquisition
    recorded: Callable[[str], str | None]
    children: FileChildren
    _kept: OrderedDict[_Key, list[dict[str, Any]]] = field(default_factory=OrderedDict, init=False)
    #: Two uploads must not both be the next one.
    _replacing: threading.Lock = field(default_factory=threading.Lock, init=False)

    def buses(self, machine: str) -> tuple[MachineRow, list[dict[str, Any]]]:
        """Return a machine, and its buses of plain CAN or J1939 as :class:`server.can_signals.signal_child.OfferedBus`.

        Raises
        ------
        InvalidError
            If reading them took more time or memory than any DBC file does.
        """
        row = self.machines.get(machine)
        path = self.files.machine_file(machine, row.version)
        names = self._names(row)
        key = (path, tuple(_state(path.parent / name) for name in names))
        found = self._kept.get(key)
        if found is None:
            found = self._read(path, None) if names else []
            self._kept[key] = found
            while len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        return row, found

    def digest(self, machine: str, name: str) -> str | None:
        """Compute SHA-256 of a file, None if it is not there."""
        path = self.files.machines / machine / name
        return digest_of(path) if path.is_file() else None

    def path(self, machine: str, name: str) -> Path:
        """Locate a file that the machine's file names; NotFoundError if it names no such file."""
        row = self.machines.get(machine)
        if name not in self._names(row):
            raise NotFoundError("server.file_machine_names_no", machine=machine)
        return self.files.machines / machine / name

    def incoming(self, machine: str, name: str) -> Path:
        """Return a new name for an upload that is to replace a file.

        Raises
        ------
        NotFoundError
            If the machine's file does not name it.
        UnsupportedFormatError
            If its name has no ending of a DBC file.
        """
        path = self.path(machine, name)
        if path.suffix.lower() not in SUFFIXES:
            raise UnsupportedFormatError("server.file_name_not_end", suffixes=", ".join(SUFFIXES))
        made = self.files.incoming()
        return made.with_name(made.name + path.suffix)

    def replace(self, incoming: Path, machine: str, name: str, expected: Tags) -> str:
        """Put an upload in the place of a file; its SHA-256. The upload is gone afterwards.

        Parameters
        ----------
        expected : SHA-256 of files that the sender knows ("0": none), None where that does not matter

        Raises
        ------
        InvalidError
            If it is no such file, or channels could not come from it; one line.
        PreconditionError
            If another file is there by now.
        ConflictError
            If the machine is being recorded.
        """
        try:
            row = self.machines.get(machine)
            path = self.path(machine, name)
            self._refuse_unusable(row, name, incoming)
            with self._replacing:
                if expected is not None and not expected & {self.digest(machine, name) or NONE_YET}:
                    raise PreconditionError("server.somebody_replaced_meanwhile", name=name)
                recording = self.recorded(machine)
                if recording is not None:
                    raise ConflictError("server.machine_being_recorded", machine=machine, recording=recording)
                write_whole(path, incoming.read_bytes())
            if row.acquire:
                self.acquisition.start(machine, self.files.machine_file(machine, row.version))
            return str(self.digest(machine, name))
        finally:
            incoming.unlink(missing_ok=True)

    def _refuse_unusable(self, row: MachineRow, name: str, incoming: Path) -> None:
        """Raise InvalidError if a file cannot be read, or takes signals from channels that had them."""
        path = self.files.machine_file(row.name, row.version)
        before = {line for bus in self.buses(row.name)[1] for line in bus["problems"]}
        for bus in self._read(path, (name, incoming)):
            errors = [file["error"] for file in bus["files"] if file["name"] == name and file["error"] is not None]
            worse = [line for line in bus["problems"] if line not in before]
            if errors or worse:
                raise InvalidError(with_messages((errors or worse)[0], bus["messages"]))

    def _names(self, row: MachineRow) -> list[str]:
        """List DBC files that a machine's file names, each once."""
        path = self.files.machine_file(row.name, row.version)
        if not path.is_file():
            raise NotFoundError("server.file_machine_gone", row=row.name)
        buses = self.reader.content(path).get("buses", ())
        return list(dict.fromkeys(name for bus in buses if bus["type"] == "can_signals" for name in bus["dbc"]))

    def _read(self, machine_file: Path, change: tuple[str, Path] | None) -> list[dict[str, Any]]:
        target, log = self.files.incoming(), self.files.recordings / "inspect.log"
        arguments = (machine_file, target, *(change or ()))
        try:
            result = self.children.run("server.can_signals.signal_child", *arguments, log=log, timeout_s=READING_S)
            if result.outcome == "done":
                content: list[dict[str, Any]] = json.loads(target.read_text(encoding="utf-8"))
                return content
        finally:
            target.unlink(missing_ok=True)
        if result.outcome == "input":
            raise InvalidError("server.dbc_files", error=result.error)
        raise refusal(
            result,
            InvalidError("server.dbc_files_take_too"),
            UnavailableError("server.dbc_files_could_not", error=result.error),
        )


def _state(path: Path) -> tuple[str, int, int]:
    """Return what changes when a file is replaced."""
    try:
        found = path.stat()
    except OSError:
        return str(path), 0, 0
    return str(path), found.st_mtime_ns, found.st_size


router = APIRouter(prefix="/can-signals", tags=["machines"], route_class=TypedRoute)
_FILE = {"application/octet-stream": BYTES}
DbcFile = Annotated[str, Query(min_length=1, max_length=1000, description="As the machine's file names it in dbc")]


@router.get("", responses=problems(404, 422, 429, 503), dependencies=[require("read")])
async def list_signals(
    service: ServiceDep,
    principal: PrincipalDep,
    machine: OneMachine,
    bus: Annotated[str | None, Query(max_length=80, description="By default all")] = None,
    search: Annotated[str, Query(max_length=200, description="Words that a signal has to have")] = "",
    limit: Limit = 100,
) -> CanSignalList:
    """List the signals of a machine's buses of plain CAN or J1939, as their DBC files describe them."""
    return await service.heavy.run(principal.id, _listed, service[SignalFiles], machine, bus, search, limit)


@router.get("/file", **sends(_FILE, 404, 422, 429, 503), dependencies=[require("read")])
async def file(service: ServiceDep, principal: PrincipalDep, machine: OneMachine, name: DbcFile) -> FileResponse:
    """Download a DBC file that a machine's file names."""
    path = await service.heavy.run(principal.id, service[SignalFiles].path, machine, name)
    if not await run_in_threadpool(path.is_file):
        raise NotFoundError("server.no_file_beside_file", name=name, machine=machine)
    return FileResponse(path, media_type="application/octet-stream", filename=path.name)


@router.post(
    "/upload",
    responses=problems(404, 409, 412, 413, 415, 422, 429, 503),
    openapi_extra=takes(_FILE, "The bytes of the file"),
    dependencies=[require("engineer")],
)
async def upload(
    request: Request,
    service: ServiceDep,
    response: Response,
    principal: PrincipalDep,
    machine: OneMachine,
    name: DbcFile,
    tags: KnownTags,
) -> CanFileReplaced:
    """Upload a DBC file in the place of one that a machine's file names; acquisition goes on with the new one."""
    files = service[SignalFiles]
    async with service.heavy.place(principal.id) as place:
        incoming = await place.run(files.incoming, machine, name)
        await receive(request.stream(), incoming, service.settings.maximum_upload_bytes, place.io)
        digest = await place.run(files.replace, incoming, machine, name, tags)
    response.headers["ETag"] = f'"{digest}"'
    return CanFileReplaced(name=name, sha256=digest)


def _listed(files: SignalFiles, machine: str, only: str | None, search: str, limit: int) -> CanSignalList:
    row, every = files.buses(machine)
    buses = [bus for bus in every if only in (None, bus["name"])]
    found = matching(buses, search)
    return CanSignalList(
        machine=machine,
        version=row.version,
        buses=[
            CanBus(**bus | {"files": [file | {"sha256": files.digest(machine, file["name"])} for file in bus["files"]]})
            for bus in buses
        ],
        found=len(found),
        items=[CanSignal(**signal) for signal in found[:limit]],
        quantities=CanSignalQuantity.all(),
    )


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
