"""Work in a process of its own, gone when it is cancelled, takes too long, or its parent dies.

The child writes JSON lines to standard output: any number of ``{"fraction": 0.4, "text": "..."}`` and last
``{"summary": {...}}`` or ``{"error": "one line"}``. Exit code 0 is done, 2 an input that cannot be used,
anything else failed.
"""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Literal

NICENESS = 19
#: One core stays free of numerical work, for acquisition and HTTP.
THREADS = str(max(1, (os.cpu_count() or 1) - 1))
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Seconds between two looks at whether the child should stop.
LOOK_S = 0.25
#: Seconds that a child has to end itself after SIGTERM.
GRACE_S = 2.0
MAXIMUM_LINE_BYTES = 2**20

Outcome = Literal["done", "input", "failed", "stopped"]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class ChildResult:
    """How a child ended; ``error`` is one line unless the outcome is ``done`` or ``stopped``.

    ``killed``: somebody else ended it by SIGKILL, a person or the kernel that ran out of memory.
    """

    outcome: Outcome
    summary: dict[str, Any] = field(default_factory=dict)
    error: str | None = None
    killed: bool = False


def run_child(
    command: Sequence[str],
    *,
    log: Path,
    timeout_s: float,
    progress: Progress = lambda fraction, text: None,
    should_stop: Callable[[], bool] = lambda: False,
    clock: Callable[[], float] = time.monotonic,
) -> ChildResult:
    """Run ``command`` to its end.

    Parameters
    ----------
    log : file to which the child's standard error is appended
    timeout_s : the child is ended after this time and the outcome is ``failed``
    progress : called with fraction (0 to 1) and text of each line of progress
    should_stop : looked at four times a second; when true the child is ended and the outcome is ``stopped``
    clock : monotonic seconds
    """
    guard = [sys.executable, "-I", "-S", str(Path(__file__).with_name("child_guard.py"))]
    guarded = [*guard, str(os.getpid()), str(NICENESS), *command]
    deadline = clock() + timeout_s
    last: dict[str, Any] = {}
    with (
        log.open("ab") as errors,
        subprocess.Popen(
            guarded,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            start_new_session=True,
            env=os.environ | dict.fromkeys(THREAD_VARIABLES, THREADS),
        ) as child,
    ):
        assert child.stdout is not None
        try:
            for line in _lines(child.stdout):
                said = None if line is None else _parse(line)
                if said is not None:
                    last = said
                    if "fraction" in said:
                        progress(float(said["fraction"]), " ".join(str(said.get("text", "")).split()))
                if should_stop():
                    return ChildResult("stopped")
                if clock() > deadline:
                    return ChildResult("failed", error=f"took longer than {timeout_s:g} s and was ended")
            child.wait()
        finally:
            _end(child)
    return _result(child.returncode, last, log)


def _lines(stream: IO[bytes]) -> Iterator[bytes | None]:
    """Lines as they come; None whenever nothing came for a while."""
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
    """The object in a line of the protocol; None for anything else that a library may have printed."""
    try:
        content = json.loads(line)
    except ValueError:
        return None
    if not isinstance(content, dict) or not content.keys() & {"fraction", "summary", "error"}:
        return None
    if not isinstance(content.get("fraction", 0.0), int | float):
        return None
    return content


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a child that still runs, and everything that it started."""
    if child.poll() is not None:
        return
    # The child leads a session of its own, so its group holds it and its children only.
    os.killpg(child.pid, signal.SIGTERM)
    try:
        child.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()


def _result(code: int, last: dict[str, Any], log: Path) -> ChildResult:
    if code == 0 and isinstance(last.get("summary"), dict):
        return ChildResult("done", summary=last["summary"])
    error = " ".join(str(last["error"]).split()) if "error" in last else None
    if error is not None and code == 2:
        return ChildResult("input", error=error)
    if error is not None:
        return ChildResult("failed", error=error)
    if code < 0:
        error = f"was ended by {signal.Signals(-code).name}; is the memory too small?"
        return ChildResult("failed", error=error, killed=code == -signal.SIGKILL)
    if code == 0:
        return ChildResult("failed", error="ended without a result")
    return ChildResult("failed", error=f"ended with exit code {code}; {log.name} says why")
