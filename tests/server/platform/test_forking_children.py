"""Children that load once and fork for each piece of work: limits, ends and isolation are those of each piece."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from server.platform.processes.children import Child, ChildResult

#: What it does is told by the first argument; ``seen`` is what an earlier piece of work would have left.
PROGRAM = """
import json, os, sys
from types import SimpleNamespace
from server.platform.processes import child_limits, forking_child
seen = []
def work(what):
    seen.append(what)
    child_limits.limit_child(1, 0)
    print("note of " + what, file=sys.stderr)
    if what == "burn":
        while True: pass
    if what == "eat":
        bytearray(10**11)
    if what == "die":
        os.kill(os.getpid(), 9)
    if what == "break off":
        sys.stdout.write('{"summary": '); sys.stdout.flush(); os.kill(os.getpid(), 9)
    if what == "refuse":
        print(json.dumps({"error": "no good"})); return 2
    if what == "hang":
        print(json.dumps({"fraction": 0, "text": str(os.getpid())}), flush=True)
        import time; time.sleep(60)
    print(json.dumps({"summary": {"pid": os.getpid(), "parent": os.getppid(), "seen": seen, "in": sys.stdin.read()}}))
    return 0
forking_child.import_module = lambda what: SimpleNamespace(main=lambda rest: work(what))
sys.exit(forking_child.main(sys.argv[1:], idle_s=%s))
"""


@pytest.fixture
def child() -> Iterator[Child]:
    with Child() as made:
        yield made


def run(child: Child, tmp_path: Path, *arguments: str, idle_s: float = 60, **options: object) -> ChildResult:
    program = [sys.executable, "-c", PROGRAM % idle_s]
    return child.run(program, arguments, log=tmp_path / arguments[0], timeout_s=280, **options)  # type: ignore[arg-type]


def test_every_piece_of_work_has_a_process_of_its_own(child: Child, tmp_path: Path) -> None:
    first, second = run(child, tmp_path, "one"), run(child, tmp_path, "two")
    assert (first.outcome, second.outcome) == ("done", "done")
    assert first.summary["parent"] == second.summary["parent"] != os.getpid()
    assert first.summary["pid"] != second.summary["pid"]
    assert [first.summary["seen"], second.summary["seen"]] == [["one"], ["two"]]
    assert first.summary["in"] == second.summary["in"] == "", "orders are not for what reads a file"
    for name in ("one", "two"):
        assert (tmp_path / name).read_text() == f"note of {name}\n"


@pytest.mark.slow
def test_the_same_child_goes_on_however_a_piece_of_work_ended(child: Child, tmp_path: Path) -> None:
    parent = run(child, tmp_path, "one").summary["parent"]
    refused = run(child, tmp_path, "refuse")
    assert (refused.outcome, refused.error) == ("input", "no good")
    burnt = run(child, tmp_path, "burn")
    assert burnt.outcome == "failed" and "SIGXCPU" in str(burnt.error) and not burnt.killed
    eaten = run(child, tmp_path, "eat")
    assert eaten.error == "ended with exit code 1; eat says why"
    assert "MemoryError" in (tmp_path / "eat").read_text()
    for what in ("die", "break off"):
        killed = run(child, tmp_path, what)
        assert killed.killed and "SIGKILL" in str(killed.error)
    assert run(child, tmp_path, "last").summary["parent"] == parent


@pytest.mark.slow
def test_what_takes_too_long_or_loses_its_parent_ends(child: Child, tmp_path: Path) -> None:
    watched: list[int] = []

    def watch(_: float, pid: str) -> None:
        watched.append(os.pidfd_open(int(pid)))

    assert run(child, tmp_path, "hang", progress=watch, should_stop=lambda: bool(watched)).outcome == "stopped"

    def kill(_: float, pid: str) -> None:
        watch(_, pid)
        stat = Path(f"/proc/{pid}/stat").read_text()
        os.kill(int(stat.rpartition(")")[2].split()[1]), signal.SIGKILL)

    assert run(child, tmp_path, "hang", progress=kill).killed
    for descriptor in watched:
        assert select.select([descriptor], [], [], 200)[0]
        os.close(descriptor)
    assert run(child, tmp_path, "one").outcome == "done"


@pytest.mark.slow
def test_a_child_that_left_for_want_of_work_is_started_again(child: Child, tmp_path: Path) -> None:
    parent = run(child, tmp_path, "one", idle_s=1).summary["parent"]
    left = os.pidfd_open(parent)
    assert select.select([left], [], [], 200)[0]
    os.close(left)
    second = run(child, tmp_path, "two", idle_s=1)
    assert second.outcome == "done"
    assert second.summary["parent"] != parent


def test_an_order_that_reaches_a_child_that_is_leaving_is_done_by_the_next(child: Child, tmp_path: Path) -> None:
    leaves = """
import json, os, sys
print(json.dumps({"summary": {"pid": os.getpid()}}))
print(json.dumps({"ended": 0, "stays": True}), flush=True)
sys.stdin.readline()  # and no answer
"""
    pids = []
    for name in ("one", "two"):
        done = child.run([sys.executable, "-c", leaves], [name], log=tmp_path / "log", timeout_s=280)
        assert done.outcome == "done"
        pids.append(done.summary["pid"])
    assert pids[0] != pids[1]
