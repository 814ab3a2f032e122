"""Declarations of resources: one :class:`Resource` in its folder, where it is found.

Routers, kept answers, the binding to machines, the tables, backups, jobs, metrics, and what starts and stops with the
service are all read from these declarations; nothing else has to know of a new resource.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Generic, TypeVar, cast, overload

import sqlalchemy as sa
from fastapi import APIRouter
from prometheus_client.core import Metric

from server.platform.database.schema import PLATFORM_TABLES

Made = TypeVar("Made")


class PartName(Generic[Made]):
    """Names a part that has no class of its own; tests put fakes in its place."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return f"PartName({self._text!r})"


#: What is wrong with the service itself, by the kind of alarm: whoever finds it writes it, alarms are made of it.
TROUBLES: PartName[dict[str, str]] = PartName("troubles of the service")

Key = type[Any] | PartName[Any]
Provider = Callable[["Parts"], Any]


class Parts:
    """The parts of a process, each made when it is first asked for, and one only.

    ::

        parts[Recordings].get(id)      # a part is asked for by its class
        parts[RECORDER].record(order)  # or, where it is a function or whatever fits a protocol, by its name

    What makes a part stands in the declaration of its resource; it asks for the parts that it needs, so nothing depends
    on the order of declarations.

    Parameters
    ----------
    providers : what makes each
    """

    def __init__(self, providers: Mapping[Key, Provider]) -> None:
        self._providers = dict(providers)
        self._made: dict[Key, Any] = {}
        self._making: list[Key] = []
        self._closing = ExitStack()

    @overload
    def __getitem__(self, key: type[Made]) -> Made: ...

    @overload
    def __getitem__(self, key: PartName[Made]) -> Made: ...

    def __getitem__(self, key: type[Made] | PartName[Made]) -> Made:
        """Return the part.

        Raises
        ------
        LookupError
            If no declaration provides it, or it needs itself.
        """
        if key not in self._made:
            if key in self._making:
                raise LookupError(f"{' needs '.join(map(_text, [*self._making, key]))}; ask for one of them later")
            if key not in self._providers:
                raise LookupError(f"no resource provides {_text(key)}; add it to `provides` of its declaration")
            self._making.append(key)
            try:
                self._made[key] = self._providers[key](self)
            finally:
                self._making.pop()
        return cast(Made, self._made[key])

    def put(self, given: Mapping[Key, Any]) -> None:
        """Put parts that exist in the place of what their providers would make."""
        self._made |= given

    def make_all(self) -> None:
        """Make every part that was not asked for yet."""
        for key in self._providers:
            self[key]

    def at_close(self, callback: Callable[[], object]) -> None:
        """Call something when the parts are closed; what was added last comes first."""
        self._closing.callback(callback)

    def entered(self, context: AbstractContextManager[Made]) -> Made:
        """Enter a context; it is left when the parts are closed."""
        return self._closing.enter_context(context)

    def close(self) -> None:
        """Close what is to be closed."""
        self._closing.close()


def _text(key: Key) -> str:
    return key.__name__ if isinstance(key, type) else repr(key)


class Phase(IntEnum):
    """Order in which things start; what starts first stops last."""

    RECOVERY = 1  # what a killed server left is put in order
    SIMULATION = 2
    JOBS = 3
    ACQUISITION = 4
    RECORDING = 5
    WATCHING = 6
    ORDERS = 7  # no stage of a job begins once this has stopped
    CLOCKS = 8


def _nothing() -> None:
    """Neither start nor stop anything."""


@dataclass(frozen=True)
class Running:
    """Something that runs while the service does; ``stop`` is called also if it never started."""

    phase: Phase
    start: Callable[[], object] = _nothing
    stop: Callable[[], object] = _nothing


@dataclass(frozen=True)
class NamedFiles:
    """Files that a store names, as paths relative to the data directory.

    Attributes
    ----------
    needed : files, or directories of results, without which something in the store would be empty
    others : files and directories that are copied if they are there
    """

    needed: frozenset[str] = frozenset()
    others: frozenset[str] = frozenset()

    def __or__(self, other: NamedFiles) -> NamedFiles:
        """Unite what either names."""
        return NamedFiles(self.needed | other.needed, self.others | other.others)


@dataclass(frozen=True)
class BackedUp:
    """Files of a resource that a backup has to hold.

    Attributes
    ----------
    folder : of the data directory, in which all of them are
    named : reads from a store which they are
    unchanging : whether a file never changes once it is there, so that a second name of it is a copy
    """

    folder: str
    named: Callable[[sa.Connection], NamedFiles]
    unchanging: bool = False


@dataclass(frozen=True)
class Resource:
    """A resource of the service.

    Attributes
    ----------
    name : of its folder; its tables, lists and collections may have others
    routers : its routes
    tables : its tables
    of_a_machine : by the collection in paths and bodies, the table whose rows (``id``) each belong to one ``machine``;
        rows with a ``job`` say to which machine that belongs
    of_no_machine : collections whose things belong to no machine: everybody who may read sees all of them
    kept : per list whose answers are kept until it changes, the revision counters that it depends on. Lists with live
        values are not here
    provides : what makes its parts
    large_uploads : paths of requests whose bodies may be as large as the setting ``maximum_upload_bytes`` says
    job_kinds : the parts that are kinds of jobs (:class:`server.jobs.job_kinds.JobKind`), each with its ``queue`` as an
        attribute of the class: workers make only those of numerical work
    running : what of its parts starts and stops with the service
    backed_up : its files
    metrics : what it counts for Prometheus
    """

    name: str
    routers: Sequence[APIRouter] = ()
    tables: Sequence[sa.Table] = ()
    of_a_machine: Mapping[str, sa.Table] = field(default_factory=dict)
    of_no_machine: frozenset[str] = frozenset()
    kept: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    provides: Mapping[Key, Provider] = field(default_factory=dict)
    large_uploads: frozenset[str] = frozenset()
    job_kinds: Sequence[type[Any]] = ()
    running: Callable[[Parts], Iterable[Running]] = lambda parts: ()
    backed_up: BackedUp | None = None
    metrics: Callable[[Parts], Iterator[Metric]] | None = None


def tables_of(resources: Iterable[Resource]) -> tuple[sa.Table, ...]:
    """List all tables of a store."""
    return (*PLATFORM_TABLES, *(table for resource in resources for table in resource.tables))


def providers_of(resources: Iterable[Resource]) -> dict[Key, Provider]:
    """Return what makes each part.

    Raises
    ------
    ValueError
        If two resources provide the same one.
    """
    found: dict[Key, Provider] = {}
    for resource in resources:
        twice = found.keys() & resource.provides.keys()
        if twice:
            raise ValueError(f"resource '{resource.name}' provides {twice}, which another resource does already")
        found |= resource.provides
    return found


def kept_lists(resources: Iterable[Resource]) -> dict[str, tuple[str, ...]]:
    """Return per list that is kept its revision counters.

    Raises
    ------
    ValueError
        If a counter is of no table: it would never move, and the list never change.
    """
    resources = tuple(resources)
    counters = {table.name for table in tables_of(resources)}
    for resource in resources:
        for path, names in resource.kept.items():
            unknown = set(names) - counters
            if unknown:
                raise ValueError(f"resource '{resource.name}': {path} depends on {unknown}, which no table is called")
    return {path: names for resource in resources for path, names in resource.kept.items()}
