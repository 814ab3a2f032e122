"""Errands: small durable work of the server beside its jobs, tried again later for as long as it asks for that.

Each try is a workflow of its own that the engine starts when its time has come, so what waits for hours holds no
thread. A try that was broken off is made again at the next start; one that succeeded is not.
"""

from __future__ import annotations

import contextvars
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dbos import DBOS, SetEnqueueOptions, SetWorkflowID


@dataclass(frozen=True)
class Errand:
    """One kind of errand.

    Attributes
    ----------
    name : of its workflows and of its queue
    at_once : most tries at a time
    run : makes a try for a subject, given its number (from 1); s until the next one, None: it is over
    """

    name: str
    at_once: int
    run: Callable[[str, int], float | None]


class Errands:
    """All errands of a process; they are added before the engine starts."""

    def __init__(self) -> None:
        self._kinds: dict[str, Errand] = {}
        self._workflows: dict[str, Any] = {}

    def add(self, errand: Errand) -> None:
        """Register a kind with the engine."""
        self._kinds[errand.name] = errand

    @property
    def queues(self) -> dict[str, int]:
        """Number of tries at a time, by queue."""
        return {name: errand.at_once for name, errand in self._kinds.items()}

    def register(self, working: Callable[[Callable[[], float | None]], float | None]) -> None:
        """Register the workflows; the engine is configured and does not run yet.

        Parameters
        ----------
        working : calls something as work of its process, and raises ServiceStopping once that stops
        """
        for name, errand in self._kinds.items():
            self._workflows[name] = self._workflow(name, errand, working)

    def _workflow(
        self, name: str, errand: Errand, working: Callable[[Callable[[], float | None]], float | None]
    ) -> Any:
        def attempt(subject: str, number: int) -> float | None:
            return working(lambda: errand.run(subject, number))

        def workflow(subject: str, number: int) -> None:
            pause = DBOS.run_step({"name": "try"}, attempt, subject, number)
            if pause is not None:
                self.send(name, subject, number + 1, pause)

        return DBOS.workflow(name=name, max_recovery_attempts=None)(workflow)

    def send(self, name: str, subject: str, number: int = 1, pause_s: float = 0.0) -> None:
        """Let a try be made after ``pause_s``; nothing happens if it was sent already, or no engine runs."""
        if name in self._workflows:
            contextvars.Context().run(self._enqueue, name, subject, number, pause_s)

    def _enqueue(self, name: str, subject: str, number: int, pause_s: float) -> None:
        with SetWorkflowID(f"{subject}-{number}"), SetEnqueueOptions(delay_seconds=pause_s or None):
            DBOS.enqueue_workflow(name, self._workflows[name], subject, number)

    def forget(self) -> None:
        """Forget the engine, which has stopped."""
        self._workflows.clear()
