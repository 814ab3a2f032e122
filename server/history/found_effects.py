"""Which effects identifications found."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from typing import Any

from server.history.history_schemas import FoundEffect
from server.identifications.identification_results import IdentificationResults
from server.platform.errors import NotFoundError

#: Identifications whose effects are kept: a report never changes.
MOST = 2000


def effects_in(loop: Mapping[str, Any]) -> tuple[FoundEffect, ...]:
    """Extract the effects in the ``loop`` of a report (or in what a calibration kept of it)."""
    return tuple(
        FoundEffect(id=str(effect["id"]), joint=effect.get("joint"), title=str(effect.get("title", effect["id"])))
        for effect in loop.get("effects", ())
    )


class FoundEffects:
    """Reads the reports of identifications, each once."""

    def __init__(self, results: IdentificationResults) -> None:
        self._results = results
        self._known: dict[str, tuple[FoundEffect, ...]] = {}
        self._lock = threading.Lock()

    def of(self, identification: str) -> tuple[FoundEffect, ...]:
        """Return the effects of an identification that is done; none where its report is gone."""
        with self._lock:
            if identification in self._known:
                return self._known[identification]
        try:
            report = json.loads((self._results.directory(identification) / "report.json").read_bytes())
            found = effects_in(report["loop"])
        except (OSError, ValueError, KeyError, TypeError, NotFoundError):
            return ()
        with self._lock:
            self._known[identification] = found
            if len(self._known) > MOST:
                del self._known[next(iter(self._known))]
        return found
