"""Children: progress, results, ends; they are nice, and die with their parent."""

from __future__ import annotations

import gc
import os
import select
import signal
import subprocess
import sys
from itertools import count
from pathlib import Path

import pytest

from daq.confinement import landlock_version
from daq.messages import Sentence
from server.platform.files import LOCK_FILE
from server.platform.processes import children
from server.platform.processes.children import Child, ChildResult, room_of, run_child

#: What children have where nobody tests.
RANKS = children.NICENESS, children.SESSION_NICENESS


@pytest.fixture
def ranked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Children have the rank that a service gives them."""
    monkeypatch.setattr(children, "NICENESS", RANKS[0])
    monkeypatch.setattr(children, "SESSION_NICENESS", RANKS[1])


def child(code: str, tmp_path: Path, **options: object) -> ChildResult:
    settings = {"timeout_s": 30.0, **options}
    return run_child([sys.executable, "-c", code], log=tmp_path / "log", **settings)  # type: ignore[arg-type]


def test_progress_and_summary(tmp_path: Path, ranked: None) -> None:
    seen: list[tuple[float, str]] = []
    code = """
import os, sys
print('{"fraction": 0.25, "text": "a  quarter"}')
print("noise of a library")
print('{"fraction": "much"}')
print('[1, 2]')
print('to the log', file=sys.stderr)
print('{"summary": {"nice": %d}}' % os.nice(0))
"""
    result = child(code, tmp_path, progress=lambda fraction, text: seen.append((fraction, text)))
    assert result == ChildResult("done", {"nice": 19})
    assert seen == [(0.25, "a quarter")]
    assert (tmp_path / "log").read_text() == "to the log\n"


@pytest.mark.slow
def test_sentences_of_a_child_are_sentences_here(tmp_path: Path) -> None:
    code = """
from daq.errors import InputError
from daq.messages import Sentence
from server.platform.processes.child_speech import ended, send
send(fraction=0.5, text=Sentence("daq.named", name="a", what="b"))
def work():
    raise InputError("daq.named", name="file.csv", what=Sentence("daq.not_a_table"))
raise SystemExit(ended(work))
"""
    seen: list[str] = []
    result = child(code, tmp_path, progress=lambda fraction, text: seen.append(text))
    assert result.outcome == "input" and isinstance(result.error, Sentence) and isinstance(seen[0], Sentence)
    assert result.error.worded("de").startswith("file.csv: ist keine Tabelle")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "outcome", "error"),
    [
        ('print(\'{"error": "wrong channel"}\'); raise SystemExit(2)', "input", "wrong channel"),
        ('print(\'{"error": "two\\\\nlines"}\'); raise SystemExit(1)', "failed", "two lines"),
        ("raise SystemExit(0)", "failed", "ended without a result"),
        ("raise SystemExit(3)", "failed", "ended with exit code 3; log says why"),
        ("print('{\"summary\": {}}'); raise SystemExit(1)", "failed", "ended with exit code 1; log says why"),
        ("import os; os.kill(os.getpid(), 9)", "failed", "was ended by SIGKILL; is the memory too small?"),
    ],
)
def test_the_end_of_a_child_is_reported_with_its_outcome_and_error(
    tmp_path: Path, code: str, outcome: str, error: str
) -> None:
    result = child(code, tmp_path)
    assert (result.outcome, result.error) == (outcome, error)


@pytest.mark.slow
def test_a_child_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    seconds = count()  # every look at the clock is a second later
    result = child("import time; time.sleep(60)", tmp_path, timeout_s=2.0, clock=lambda: float(next(seconds)))
    assert result.error == "took longer than 2 s and was ended"
    assert not result.exceeded  # a computer that has much else to do says nothing of the file


@pytest.mark.slow
def test_a_child_that_a_person_waits_for_is_as_nice_as_its_session(tmp_path: Path, ranked: None) -> None:
    # Where the kernel ranks no sessions, one at 19 has a hundredth of the processor beside one busy program.
    code = 'import os; print(\'{"summary": {"nice": %d}}\' % os.nice(0))'
    with Child(awaited=True) as waited_for:
        result = waited_for.run([sys.executable, "-c", code], log=tmp_path / "log", timeout_s=30.0)
    assert result.summary == {"nice": max(RANKS[1], os.getpriority(os.PRIO_PROCESS, 0))}


@pytest.mark.slow
def test_a_child_that_ignores_sigterm_is_killed_with_its_own_children(tmp_path: Path) -> None:
    inner = """
import json, os, signal, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print(json.dumps({"fraction": 0, "text": str(os.getpid())}), flush=True)
time.sleep(60)
"""
    code = f"""
import signal, subprocess, sys
signal.signal(signal.SIGTERM, signal.SIG_IGN)
subprocess.run([sys.executable, "-c", {inner!r}])
"""
    watched: list[int] = []
    result = child(
        code,
        tmp_path,
        progress=lambda fraction, text: watched.append(os.pidfd_open(int(text))),
        should_stop=lambda: bool(watched),
    )
    assert result == ChildResult("stopped")
    # The signal was sent to both; the inner process may need a moment on a busy computer to die of it.
    assert has_ended(watched[0])


STAYS = """
import json, os, sys
arguments = sys.argv[1:]
while True:
    if "fail" in arguments:
        print(json.dumps({"error": "no"})); sys.exit(2)
    print(json.dumps({"summary": {"pid": os.getpid(), "did": arguments}, "stays": "once" not in arguments}), flush=True)
    order = sys.stdin.readline() if "once" not in arguments else ""
    if not order:
        break
    arguments = json.loads(order)["arguments"]
    with open(json.loads(order)["log"], "a") as log:
        log.write("told\\n")
"""


SAYS_RANK = """
import json, os
group = open("/proc/self/autogroup").read().split()[-1]
print(json.dumps({"summary": {"nice": os.nice(0), "session": int(group)}}))
"""


@pytest.mark.skipif(not Path("/proc/self/autogroup").is_file(), reason="the kernel knows no ranks of sessions")
def test_a_childs_session_is_nice_as_well(tmp_path: Path, ranked: None) -> None:
    """Else it has as much of the processor as the whole session of the service (sched(7), autogroup)."""
    assert child(SAYS_RANK, tmp_path).summary == {"nice": 19, "session": 5}


def test_a_child_that_stays_does_what_comes_next(tmp_path: Path) -> None:
    program = [sys.executable, "-c", STAYS]

    def run(*arguments: str, program: list[str] = program) -> ChildResult:
        return child.run(program, arguments, log=tmp_path / arguments[0], timeout_s=30.0)

    with Child() as child:
        first, second = run("one"), run("two", "words")
        assert [r.summary["did"] for r in (first, second)] == [["one"], ["two", "words"]]
        assert first.summary["pid"] == second.summary["pid"]
        assert (tmp_path / "two").read_text() == "told\n"
        other = run("three", program=[*program, "another"])
        assert other.summary["did"] == ["another", "three"] and other.summary["pid"] != first.summary["pid"]
        watched = os.pidfd_open(run("four").summary["pid"])
        failed = run("fail")
        assert (failed.outcome, failed.error) == ("input", "no")
        assert has_ended(watched)
        after = run("five")
        assert after.outcome == "done"
        watched = os.pidfd_open(after.summary["pid"])
    assert has_ended(watched)


def test_a_child_that_died_while_it_stayed_is_started_again(tmp_path: Path) -> None:
    with Child() as child:
        first = child.run([sys.executable, "-c", STAYS], ["one"], log=tmp_path / "log", timeout_s=30.0)
        watched = os.pidfd_open(first.summary["pid"])
        os.kill(first.summary["pid"], signal.SIGKILL)
        assert has_ended(watched)
        second = child.run([sys.executable, "-c", STAYS], ["two", "once"], log=tmp_path / "log", timeout_s=30.0)
    assert second.outcome == "done"
    assert second.summary["pid"] != first.summary["pid"]


def has_ended(descriptor: int) -> bool:
    """Whether a process ends within half a minute: its pidfd is readable then. Closes the descriptor."""
    try:
        return bool(select.select([descriptor], [], [], 30)[0])
    finally:
        os.close(descriptor)


def test_a_child_dies_when_its_parent_is_killed(tmp_path: Path) -> None:
    pid_file = tmp_path / "pid"
    inner = f"""
import os, time
open({str(pid_file)!r}, "w").write(str(os.getpid()))
print('{{"fraction": 0}}', flush=True)
time.sleep(60)
"""
    outer = f"""
import sys
from pathlib import Path
from server.platform.processes.children import run_child
run_child([sys.executable, "-c", {inner!r}], log=Path({str(tmp_path / "log")!r}), timeout_s=60,
          progress=lambda *_: print("up", flush=True))
"""
    with subprocess.Popen([sys.executable, "-c", outer], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == b"up\n"
        pid = int(pid_file.read_text())
        watch = os.pidfd_open(pid)
        os.kill(parent.pid, signal.SIGKILL)
    assert has_ended(watch)


@pytest.mark.skipif(landlock_version() < 3, reason="this kernel has no Landlock of version 3")
def test_a_child_writes_in_its_own_room_only(tmp_path: Path) -> None:
    room = tmp_path / "recordings"
    room.mkdir()
    store, key = tmp_path / "hilfit.sqlite", tmp_path / "tls" / "key.pem"
    key.parent.mkdir()
    for path in (store, key, tmp_path / LOCK_FILE):
        path.write_text("precious")
    code = """
import json, pathlib, sys, tempfile
refused = []
for path in sys.argv[1:]:
    try:
        pathlib.Path(path).write_text("spoilt")
    except PermissionError:
        refused.append(path)
with tempfile.NamedTemporaryFile() as file:
    print(json.dumps({"summary": {"refused": refused, "scratch": tempfile.gettempdir()}}))
"""
    paths = [str(path) for path in (store, key, room / "deep.txt")]
    (room / "place").mkdir()
    with Child() as process:
        result = process.run([sys.executable, "-c", code], paths, log=room / "place" / "log", timeout_s=30)
    assert result.summary["refused"] == paths[:2]
    assert (store.read_text(), key.read_text(), (room / "deep.txt").read_text()) == ("precious", "precious", "spoilt")
    del process
    gc.collect()
    assert not Path(result.summary["scratch"]).exists()


@pytest.mark.parametrize("lock", [LOCK_FILE, f"{LOCK_FILE}-worker-fits-1"])
def test_all_jobs_of_a_server_or_a_worker_are_in_one_room_so_their_process_can_stay(tmp_path: Path, lock: str) -> None:
    (tmp_path / lock).touch()
    logs = [tmp_path / "identifications" / id / "1-check" / "check.log" for id in ("idn-1", "idn-2")]
    assert {room_of(log) for log in logs} == {tmp_path.resolve() / "identifications"}
