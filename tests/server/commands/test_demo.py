"""``hilfit demo`` as people use it: interrupted, killed, started twice, and with the result that README.md prints.

Recordings of demos that are not let to their end are half as long as the demo's own.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.demonstration import APART
from benchmarks.readme import numbers, printed_result, said_by_the_demo

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

COMMAND = [sys.executable, "-m", "server.commands.command_line", "demo"]


def demo(
    folder: Path, *, until: str = "", then: Callable[[subprocess.Popen[str]], None] | None = None
) -> tuple[int, str, str]:
    """Run the demo in ``folder``; when it says ``until``, do something. Status and what it printed."""
    said = ""
    with subprocess.Popen(
        [*COMMAND, *(() if then is None else ("--seconds", "20"))],
        cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    ) as running:  # fmt: skip
        assert running.stdout is not None and running.stderr is not None
        for line in running.stderr:
            said += line
            if then is not None and until in line:
                then(running)
                then = None
        printed = running.stdout.read()
    return running.returncode, printed, said


def words(result: str) -> list[str]:
    """All but numbers, lines of the table, and how many terms the law of the friction has."""
    return re.findall(r"[a-z]\w*", re.sub(r"\(f_1.*?\); with", "with", result, flags=re.DOTALL))


def left(folder: Path) -> set[str]:
    """Reports, and files of recordings."""
    made = folder / "hilfit-demo"
    return {path.name for pattern in ("*.json", "*.html", "recordings/*") for path in made.glob(pattern)}


def test_it_is_interrupted_killed_started_twice_and_does_what_readme_says(tmp_path: Path) -> None:
    made = tmp_path / "hilfit-demo"
    made.mkdir()
    for name in ("report.html", "report.json", "model.json", "mine.html"):
        (made / name).write_text("of an earlier demo, or mine")
    second: list[subprocess.CompletedProcess[str]] = []

    def interrupt(running: subprocess.Popen[str]) -> None:
        """Try another one in the same folder, then press Ctrl-C, which goes to all processes of a terminal."""
        second.append(subprocess.run(COMMAND, cwd=tmp_path, capture_output=True, text=True, timeout=120))
        os.killpg(running.pid, signal.SIGINT)

    status, printed, said = demo(tmp_path, until="recording train-1", then=interrupt)
    (other,) = second
    assert (other.returncode, other.stdout) == (2, "")
    assert other.stderr.startswith("hilfit: hilfit-demo: another demo is running in this directory")
    assert len(other.stderr.splitlines()) == 1
    assert (status, printed) == (130, "")
    assert re.fullmatch(r"hilfit: interrupted \([a-z0-9 -]+\)", said.splitlines()[-1])
    assert {"mine.html", "unloaded.parquet"} <= left(tmp_path)
    assert not {"report.html", "report.json", "model.json"} & left(tmp_path)

    status, _, _ = demo(
        tmp_path, until="recording unloaded", then=lambda running: os.killpg(running.pid, signal.SIGKILL)
    )
    assert status == -signal.SIGKILL
    (made / "recordings" / "train-2.parquet.journal").write_bytes(b"a kill left it")

    status, printed, said = demo(tmp_path)
    assert status == 0, f"the journal of a demo that was killed is no obstacle: {said}"
    assert not [name for name in left(tmp_path) if name.endswith(".journal")]
    result, readme = said_by_the_demo(printed), printed_result()
    assert words(result) == words(readme)
    for own, theirs in zip(numbers(result), numbers(readme), strict=True):
        assert own == pytest.approx(theirs, rel=APART, abs=0.05), "README.md's result is made by: make readme"
