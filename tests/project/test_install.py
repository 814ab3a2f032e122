"""``make demo`` on a computer that is not ready: an environment cut short or moved, an index that is away."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INSTALL = ROOT / ".ci" / "install"

#: A Python that makes environments as told: whole, or half and then killed.
PYTHON = """#!/bin/sh
case "$*" in
  "-m venv --clear "*)
    echo made >> "{log}"
    rm -rf "$4"; mkdir -p "$4/bin"; touch "$4/bin/python"
    [ ! -e "{log}.kill" ] || kill -KILL $$ ;;
esac
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with the Makefile, and a Python beside it."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    shutil.copy(ROOT / "Makefile", folder)
    python = tmp_path / "python"
    python.write_text(PYTHON.format(log=tmp_path / "log"))
    python.chmod(0o755)
    return folder


def environment_made(folder: Path) -> tuple[int, int]:
    """Status of making the environment, and how often one was begun until now."""
    command = ["make", "--silent", f"PYTHON={folder.parent / 'python'}", ".venv/.made"]
    variables = {key: value for key, value in os.environ.items() if not key.startswith("MAKE")}
    status = subprocess.run(command, cwd=folder, capture_output=True, timeout=60, env=variables).returncode
    return status, len((folder.parent / "log").read_text().splitlines())


def test_an_environment_that_was_killed_while_it_was_made_is_made_again(checkout: Path) -> None:
    kill = checkout.parent / "log.kill"
    kill.touch()
    assert environment_made(checkout) == (2, 1)
    assert (checkout / ".venv" / "bin" / "python").exists(), "half of it is there"
    kill.unlink()
    assert environment_made(checkout) == (0, 2)
    assert environment_made(checkout) == (0, 2), "a whole one stays"


def test_an_environment_that_was_moved_is_made_again(checkout: Path) -> None:
    assert environment_made(checkout) == (0, 1)
    moved = checkout.rename(checkout.with_name("moved"))
    assert environment_made(moved) == (0, 2)
    assert environment_made(moved) == (0, 2)


def test_what_was_installed_is_installed_again_in_a_new_environment() -> None:
    """The stamps of what is installed are newer than the environment's."""
    rules = (ROOT / "Makefile").read_text()
    for stamp in (".use", ".dev"):
        (line,) = [line for line in rules.splitlines() if line.startswith(f"$(VENV)/{stamp}:")]
        assert "$(MADE)" in line.partition("|")[0].split()


def installed(tmp_path: Path, pip: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the installation with a pip that does what ``pip`` says (a shell script)."""
    python = tmp_path / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True, exist_ok=True)
    python.write_text(f"#!/bin/sh\ncase \"$*\" in *'pip config'*) exit 1 ;; esac\n{pip}\n")
    python.chmod(0o755)
    lock = tmp_path / "lock.txt"
    lock.write_text("# a comment\n" + "".join(f"package-{n}==1 \\\n    --hash=sha256:00\n" for n in range(45)))
    command = [str(INSTALL), str(python), "--require-hashes", "-r", str(lock)]
    plain = {"PATH": os.environ["PATH"], **environment}
    # A job in the background of a shell ignores interruptions, and so would what it starts.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=60, env=plain)
    finally:
        signal.signal(signal.SIGINT, before)


def test_it_says_how_far_it_is(tmp_path: Path) -> None:
    pip = (
        "n=0; while [ $n -lt 45 ]; do n=$((n + 1)); echo Collecting package; done; echo Installing collected packages:"
    )
    done = installed(tmp_path, pip)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr.splitlines() == [
        "install: 45 packages, a minute or two",
        "install: 20 of 45 fetched",
        "install: 40 of 45 fetched",
        "install: all fetched, unpacking",
    ]
    assert not (tmp_path / "venv" / "install.log").exists()


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ("ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device", "is full; "),
        ("ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE.", "other files than those"),
        ("ERROR: No matching distribution found for numpy==2.4", "index PyPI does not answer or lacks a package"),
        ("ERROR: something that nobody foresaw", "install: ERROR: something that nobody foresaw"),
    ],
)
def test_a_failure_is_a_line_that_says_what_to_do(tmp_path: Path, said: str, wanted: str) -> None:
    done = installed(tmp_path, f"echo '{said}'; exit 1")
    assert done.returncode == 1
    _, told, where = done.stderr.splitlines()
    assert wanted in told
    assert (tmp_path / "venv" / "install.log").read_text().splitlines() == [said, "ended with 1"]
    assert where.endswith("install.log")


def test_a_full_temporary_folder_is_named(tmp_path: Path) -> None:
    """One that does not exist has no room at all."""
    done = installed(tmp_path, "echo 'OSError: [Errno 28] No space left on device'; exit 1", TMPDIR="/dev/full-folder")
    assert "/dev/full-folder is full; name another temporary folder" in done.stderr


def test_an_interruption_is_no_failure_of_the_index(tmp_path: Path) -> None:
    done = installed(tmp_path, f"kill -{signal.SIGINT.value} $$")
    assert done.returncode == 128 + signal.SIGINT
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
def test_an_index_that_is_away_is_named_after_a_few_seconds(tmp_path: Path) -> None:
    """With pip itself; nobody listens on port 1 of this computer."""
    python = tmp_path / "venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    environment = {
        "PATH": os.environ["PATH"],
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": "http://somebody:secret@127.0.0.1:1/simple",
    }
    command = [str(INSTALL), str(python), "--target", str(tmp_path / "target"), "nothing-of-that-name==1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
    assert done.returncode == 1
    trying, told, _ = done.stderr.splitlines()
    assert trying == "install: the package index does not answer, trying again"
    assert "http://127.0.0.1:1/simple does not answer" in told and "PIP_INDEX_URL" in told
    assert "secret" not in done.stderr
