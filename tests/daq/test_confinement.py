"""A confined process writes below the folders that it was given, and nowhere else, whatever it calls."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from bench_machines import HEAD

from daq import parse_machine
from daq.acquisition.acquisition import AcquisitionProcess
from daq.confinement import landlock_version
from daq.errors import AcquisitionError

needs_landlock = pytest.mark.skipif(landlock_version() < 3, reason="this kernel has no Landlock of version 3")
ATTEMPTS = """
import os, sys
from daq.confinement import confine
mine, other = sys.argv[1:]
assert confine([mine, "/dev", "/no/such/folder"])
def tried(what):
    try:
        what()
    except PermissionError:
        return "refused"
    return "done"
def write(folder):
    with open(folder + "/new", "w") as file:
        file.write("x")
for folder in (mine, other):
    print(*(tried(what) for what in (
        lambda: write(folder),
        lambda: open(folder + "/store", "r+").close(),
        lambda: os.truncate(folder + "/store", 0),
        lambda: os.mkdir(folder + "/sub"),
        lambda: os.symlink("/etc", folder + "/link"),
        lambda: os.rename(folder + "/store", folder + "/moved"),
        lambda: os.unlink(folder + "/key"),
        lambda: open(folder + "/read").close(),
    )))
print(tried(lambda: os.rename(mine + "/moved", other + "/x")), tried(lambda: os.system("true")), flush=True)
os.execv(sys.executable, [sys.executable, "-c", "import sys; open(sys.argv[1], 'w')", other + "/after"])
"""
VANDAL = """
from daq.errors import AcquisitionError
class Driver:
    def __init__(self, bus, channels, context):
        try:
            open(bus.options["file"], "w").close()
        except PermissionError:
            raise AcquisitionError("refused") from None
        raise AcquisitionError("written")
"""


@needs_landlock
def test_every_way_to_write(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("mine", "other")]
    for folder in folders:
        folder.mkdir()
        for name in ("store", "key", "read"):
            (folder / name).write_text("precious")
    done = subprocess.run([sys.executable, "-c", ATTEMPTS, *map(str, folders)], capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert lines == [" ".join(["done"] * 8), " ".join(["refused"] * 7 + ["done"]), "refused done"], done.stderr
    assert "PermissionError" in done.stderr and done.returncode == 1  # also what it becomes is confined
    assert sorted(path.name for path in folders[1].iterdir()) == ["key", "read", "store"]
    assert (folders[1] / "store").read_text() == "precious"


@pytest.mark.slow
@needs_landlock
def test_a_driver_cannot_write_to_the_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "code" / "vandal-1.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: vandal\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[hilfit.drivers]\nvandal = vandal:Driver\n")
    (tmp_path / "code" / "vandal.py").write_text(VANDAL)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "code"))
    store = tmp_path / "data" / "hilfit.sqlite"
    store.parent.mkdir()
    store.write_bytes(b"precious")
    channels = "".join(
        f"- {{name: {name}, quantity: {quantity}, joint: j1, unit: {unit}, source: {{bus: b, address: {{x: 1}}}}}}\n"
        for name, quantity, unit in (("a", "joint_position", "rad"), ("e", "joint_effort", "N m"))
    )
    text = (
        HEAD.format(rate=50) + f"channels:\n{channels}buses:\n- {{name: b, type: vandal, options: {{file: {store}}}}}\n"
    )
    process = AcquisitionProcess(parse_machine(text), data_directory=store.parent)
    try:
        process.start()
        with pytest.raises(AcquisitionError, match=r"^refused$"):
            process.wait_running()
    finally:
        process.stop()
    assert store.read_bytes() == b"precious"
