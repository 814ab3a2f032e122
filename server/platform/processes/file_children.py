"""The service's side of work on files from outside: children that stay loaded, and one fork of theirs per file."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from server.platform.errors import InvalidError, ServiceError
from server.platform.processes.children import Child, ChildResult

PROGRAM = (sys.executable, "-P", "-m", "server.platform.processes.forking_child")


class _Lane:
    """A child and the thread that started it: the kernel ends a child with that."""

    def __init__(self, room: Path | None) -> None:
        # One thread of a numerical library: what forks should have no others.
        self.child = Child(threads="1", room=room, awaited=True)
        self.thread = ThreadPoolExecutor(1, "file-child")


class FileChildren:
    """Does work on files in processes forked from children that have loaded what it takes.

    There are as many children as there is work at once, which who asks has to bound
    (:class:`server.platform.processes.heavy_work.Heavy`). A child that has nothing to do for a minute ends.
    """

    def __init__(self, program: Sequence[str] = PROGRAM, room: Path | None = None) -> None:
        self._program = tuple(program)
        self._room = room
        self._idle: list[_Lane] = []
        self._lock = threading.Lock()
        self._closed = False

    def run(self, module: str, *arguments: object, log: Path, timeout_s: float) -> ChildResult:
        """Do one piece of work.

        Parameters
        ----------
        module : whose ``main`` takes the arguments, as texts, and speaks the protocol of
            :mod:`server.platform.processes.children`
        log : file to which standard error is appended
        timeout_s : after which the work is ended and the outcome is ``failed``
        """
        texts = (module, *map(str, arguments))
        with self._lock:
            # The one that was used last: the others may end.
            lane = self._idle.pop() if self._idle else _Lane(self._room)
        try:
            work = partial(lane.child.run, self._program, texts, log=log, timeout_s=timeout_s)
            return lane.thread.submit(work).result()
        finally:
            with self._lock:
                self._idle.append(lane)
                closed = self._closed
            if closed:
                self.close()

    def close(self) -> None:
        """End the children; one that is at work is ended when it is done."""
        with self._lock:
            self._closed = True
            lanes, self._idle = self._idle, []
        for lane in lanes:
            lane.thread.shutdown()
            lane.child.__exit__()


def refusal(result: ChildResult, too_much: ServiceError, failed: ServiceError) -> ServiceError:
    """Return the error to raise for work that was not done.

    Parameters
    ----------
    result : what is wrong with the file is in it where it ended as ``input``
    too_much : if the file took more processor time or memory than any honest one does
    failed : if anything else is wrong, or the computer had no time for it
    """
    if result.outcome == "input":
        return InvalidError(result.error or "")
    return too_much if result.exceeded else failed
