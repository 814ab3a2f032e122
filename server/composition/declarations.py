"""All resources of the service: what the ``*_resource.py`` of each folder of ``server`` declares."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules

import server
from server.platform.resource import Resource, tables_of

#: Routes are tried in this order, one after the other: what pages ask for most comes first, a new resource last.
ORDER = (
    "live", "machines", "bus_checks", "can_signals", "monitor", "fleet", "history", "traces", "recordings",
    "identifications", "valves", "excitations", "schedules", "recalibrations", "calibrations", "backups", "jobs",
    "effects", "alarms", "outward", "access", "audit", "log_lines",
)  # fmt: skip


def _declared() -> Iterator[Resource]:
    for folder in (own.name for own in iter_modules(server.__path__, "server.") if own.ispkg):
        for module in iter_modules(import_module(folder).__path__, f"{folder}."):
            if module.name.endswith("_resource"):
                yield from (own for own in vars(import_module(module.name)).values() if isinstance(own, Resource))


RESOURCES = tuple(sorted(_declared(), key=lambda own: (*ORDER, own.name).index(own.name)))
#: All tables of the store.
TABLES = tables_of(RESOURCES)
