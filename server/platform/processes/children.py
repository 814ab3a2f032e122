"""Work in a process of its own, gone when it is cancelled, takes too long, or its parent dies.

The child writes JSON lines to standard output: any number of ``{"fraction": 0.4, "text": "..."}`` and last
``{"summary": {...}}`` or ``{"error": "one line"}``, each with the ``messages`` that its sentences were made of
(:func:`daq.messages.with_their_messages`). Exit code 0 is done, 2 an input that cannot be used,
anything else failed.

A child writes only in its room of the data directory (:func:`room_of`) and to devices, where the kernel can confine it
(:mod:`daq.confinement`). Its temporary files are in a directory of that room that is gone with it, or, if the server
was killed, with the next start of the server.

A child may stay for more of the same program, so that its libraries and its input are loaded once: its last line is
then ``{"summary": {...}, "stays": true}``, and it reads ``{"arguments": [...], "log": "..."}`` from standard input,
until that ends. One that does each piece of work in a process forked from it
(:mod:`server.platform.processes.forking_child`) says with ``{"ended": EXIT_CODE, "stays": true}`` how that one ended.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal, Self

from daq import confinement
from daq.messages import Sentence, one_line, put_together
from server.platform.files import LOCK_FILE, TEMPORARY

#: Within the session of a child, and of that among others: a third of an ordinary one. At 19 nothing was ever done on a
#: computer that has always something to do.
NICENESS, SESSION_NICENESS = 19, 5
#: One core stays free of numerical work, for acquisition and HTTP.
THREADS = str(max(1, (os.cpu_count() or 1) - 1))
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Allocators that reserve memory ahead would make any limit of it (``child_limits``) a guess.
ALLOCATORS = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}
#: Seconds between two looks at whether the child should stop.
LOOK_S = 0.25
#: Seconds that a child has to end itself after SIGTERM.
GRACE_S = 2.0
MAXIMUM_LINE_BYTES = 2**20

Outcome = Literal["done", "input", "failed", "stopped"]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class ChildResult:
    """Outcome of a child; ``error`` is one line unless the outcome is ``done`` or ``stopped``.

    ``killed``: somebody else ended it by SIGKILL, a person or the kernel that ran out of memory. ``exceeded``: it was
    ended by a signal (``killed`` or not), for what it took; not because its time was over, which tells of the computer.
    """

    outcome: Outcome
    summary: dict[str, Any] = field(default_factory=dict)
    error: str | None = None
    killed: bool = False
    exceeded: bool = False


@dataclass(eq=False)
class Child:
    """A process for one run after another; a context manager that ends it.

    Every run starts a process of its own, unless the one before was of the same program and says that it stays.

    Attributes
    ----------
    clock : monotonic seconds
    threads : most of a numerical library in the child
    room : where it may write, in the place of :func:`room_of` its log
    awaited : whether a person waits for it: it is then as nice as its session, where no session has a rank as well
    """

    clock: Callable[[], float] = time.monotonic
    threads: str = THREADS
    room: Path | None = None
    awaited: bool = False
    _staying: tuple[tuple[object, ...], subprocess.Popen[bytes]] | None = field(default=None, init=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """End the kept process, if there is one; the next run starts another."""
        if self._staying is not None:
            _, process = self._staying
            self._staying = None
            _end(process)

    def run(
        self,
        program: Sequence[str],
        arguments: Sequence[str] = (),
        *,
        log: Path,
        timeout_s: float,
        progress: Progress = lambda fraction, text: None,
        should_stop: Callable[[], bool] = lambda: False,
    ) -> ChildResult:
        """Run ``program`` with ``arguments`` to its end, or until it has done that and is kept.

        Parameters
        ----------
        log : file to which the child's standard error is appended
        timeout_s : the child is ended after this time and the outcome is ``failed``
        progress : called with fraction (0 to 1) and text of each line of progress
        should_stop : looked at four times a second; when true the child is ended and the outcome is ``stopped``
        """
        looked = self.clock()
        deadline = looked + timeout_s
        room = self.room or room_of(log)
        known = (room, *program)  # another room is another process: this one cannot leave the one that it was given
        process = self._reused(known, arguments, log)
        reused = process is not None
        own = os.getpriority(os.PRIO_PROCESS, 0)  # which only the few may go below
        niceness = max(own, SESSION_NICENESS) if self.awaited else NICENESS
        process = process or _started([*program, *arguments], log, self.threads, room, niceness)
        assert process.stdout is not None
        last: dict[str, Any] = {}
        try:
            for line in _lines(process.stdout):
                reply = None if line is None else _parse(line)
                if reply is not None and "ended" in reply:
                    self._staying = (known, process)
                    return _result(int(reply["ended"]), last, log)
                if reply is not None:
                    last = reply
                    if "fraction" in reply:
                        progress(float(reply["fraction"]), one_line(str(reply.get("text", ""))))
                    if isinstance(reply.get("summary"), dict) and reply.get("stays") is True:
                        self._staying = (known, process)
                        return ChildResult("done", summary=reply["summary"])
                now = self.clock()
                if line is not None and now - looked < LOOK_S:
                    continue
                looked = now
                if should_stop():
                    return ChildResult("stopped")
                if now > deadline:
                    error = Sentence("server.took_longer", timeout_s=timeout_s)
                    return ChildResult("failed", error=error)
            process.wait()
        finally:
            if self._staying is None:
                _end(process)
        if reused and not last and process.returncode == 0:  # it had nothing to do for long, and was just leaving
            left = max(0.0, deadline - self.clock())
            return self.run(program, arguments, log=log, timeout_s=left, progress=progress, should_stop=should_stop)
        return _result(process.returncode, last, log)

    def _reused(self, known: tuple[object, ...], arguments: Sequence[str], log: Path) -> subprocess.Popen[bytes] | None:
        """Order the kept process to do the next work; None if there is none for it."""
        if self._staying is None:
            return None
        (own, process), self._staying = self._staying, None
        order = json.dumps({"arguments": list(arguments), "log": str(log)}).encode() + b"\n"
        if own == known and process.poll() is None:
            assert process.stdin is not None
            with suppress(BrokenPipeError):
                process.stdin.write(order)
                return process
        _end(process)
        return None


def run_child(
    command: Sequence[str],
    *,
    log: Path,
    timeout_s: float,
    progress: Progress = lambda fraction, text: None,
    should_stop: Callable[[], bool] = lambda: False,
    clock: Callable[[], float] = time.monotonic,
) -> ChildResult:
    """Run ``command`` once; see :class:`Child`."""
    with Child(clock) as child:
        return child.run(command, log=log, timeout_s=timeout_s, progress=progress, should_stop=should_stop)


def _started(command: Sequence[str], log: Path, threads: str, room: Path, niceness: int) -> subprocess.Popen[bytes]:
    """Start a process below the guard."""
    guard = [sys.executable, "-I", "-S", str(Path(__file__).with_name("child_guard.py"))]
    scratch = tempfile.TemporaryDirectory(prefix=TEMPORARY, dir=room, ignore_cleanup_errors=True)
    writable = os.pathsep.join((str(room), "/dev"))
    with log.open("ab") as errors:
        process = subprocess.Popen(
            [*guard, str(os.getpid()), f"{niceness} {SESSION_NICENESS}", confinement.__file__, writable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
            bufsize=0,
            env=os.environ | dict.fromkeys(THREAD_VARIABLES, threads) | ALLOCATORS | {"TMPDIR": scratch.name},
        )
    weakref.finalize(process, scratch.cleanup)
    return process


def room_of(log: Path) -> Path:
    """Return where a child may write: in the folder of the data directory that its log is in.

    So it reaches what jobs or uploads leave there, and neither the store, nor keys, nor what other resources keep. A
    worker's directory has the lock of its name.
    """
    folder = log.resolve().parent
    locks = (LOCK_FILE, f"{LOCK_FILE}-worker-*")
    rooms = (own for own in (folder, *folder.parents) if any(any(own.parent.glob(lock)) for lock in locks))
    return next(rooms, folder)


def _lines(stream: IO[bytes]) -> Iterator[bytes | None]:
    """Yield lines as they come; None whenever nothing came for a while."""
    pending = b""
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        while True:
            if not selector.select(LOOK_S):
                yield None
                continue
            chunk = os.read(stream.fileno(), 65536)
            if not chunk:
                return
            *lines, pending = (pending + chunk).split(b"\n")
            # A child that writes without end and without lines must not fill our memory.
            pending = pending[-MAXIMUM_LINE_BYTES:]
            yield from lines


def _parse(line: bytes) -> dict[str, Any] | None:
    """Parse the object in a line of the protocol; None for anything else that a library may print."""
    try:
        content = json.loads(line)
    except ValueError:
        return None
    if not isinstance(content, dict) or not content.keys() & {"fraction", "summary", "error", "ended"}:
        return None
    if not isinstance(content.get("fraction", 0.0), int | float) or not isinstance(content.get("ended", 0), int):
        return None
    return put_together(content)


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a child that still runs, and everything that it started; nothing more is read of it."""
    if child.poll() is None:
        # The child leads a session of its own, so its group holds it and its children only.
        os.killpg(child.pid, signal.SIGTERM)
        try:
            child.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)
            child.wait()
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            pipe.close()


def _result(code: int, last: dict[str, Any], log: Path) -> ChildResult:
    if code == 0 and isinstance(last.get("summary"), dict):
        return ChildResult("done", summary=last["summary"])
    error = one_line(str(last["error"])) if "error" in last else None
    if error is not None and code == 2:
        return ChildResult("input", error=error)
    if error is not None:
        return ChildResult("failed", error=error)
    if code < 0:
        error = Sentence("server.ended_by_signal", name=signal.Signals(-code).name)
        return ChildResult("failed", error=error, killed=code == -signal.SIGKILL, exceeded=True)
    if code == 0:
        return ChildResult("failed", error=Sentence("server.ended_without_result"))
    return ChildResult("failed", error=Sentence("server.ended_with_code", exit=code, log=log.name))
