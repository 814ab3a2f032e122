"""A service with access control, and principals of every kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from service_fakes import MACHINE, Fakes, Running, running_service

from server.access.access_desk import Access
from server.machines.machine_desk import MachineDesk
from server.platform.authorization.principals import SERVICE, Role

#: A second machine, to which some principals are bound.
OTHER = MACHINE.replace("name: lever", "name: other")


class Clock:
    """Stands still until it is told."""

    def __init__(self) -> None:
        self.now = datetime(2026, 3, 1, 12, tzinfo=UTC)

    def __call__(self) -> datetime:
        return self.now


class Guarded:
    """A service with access control; ``bearer`` makes the headers of a principal of a role."""

    def __init__(self, running: Running) -> None:
        self.running = running
        self.client = running.client
        self._headers: dict[tuple[Role, tuple[str, ...] | None], dict[str, str]] = {}

    def bearer(self, role: Role, machines: tuple[str, ...] | None = None) -> dict[str, str]:
        if (role, machines) not in self._headers:
            _, token = self.running.service[Access].make_key(f"a {role}", role, machines, SERVICE)
            self._headers[role, machines] = {"Authorization": f"Bearer {token}"}
        return self._headers[role, machines]


@contextmanager
def guarded_service(data_dir: Path, **settings: Any) -> Iterator[Guarded]:
    """With two machines, ``lever`` and ``other``; limits of rate are far away unless given."""
    chosen = {"access": "required", "requests_per_second": 10_000.0} | settings
    with running_service(data_dir, Fakes(), **chosen) as running:
        guarded = Guarded(running)
        for content in (MACHINE, OTHER):
            running.service[MachineDesk].upload(content.encode())
        yield guarded
