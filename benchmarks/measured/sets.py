"""The measured sets as files and as recordings: what every benchmark on them begins with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from benchmarks.measured import emps, staubli
from daq.machine.machine_file import Machine, load_machine
from daq.recordings.recording import Recording, read_recording
from fitting.loop.session import Options, Session

#: Folder of each set below that of the measured data.
FOLDERS = {"EMPS": "emps", "TX40": "staubli_tx40", "KUKA LWR": "kuka_lwr4"}
#: Share of the TX40's one recording that is fitted; its last tenth stands still.
FITTED = 0.7


def files(name: str, data: Path, folder: Path) -> tuple[Path, list[tuple[str, Path]]] | None:
    """Locate a set's machine file and recordings by role; None if its data is absent. Files are made in ``folder``."""
    place = data / FOLDERS[name]
    if not place.is_dir():
        return None
    if name == "TX40":
        return staubli.MACHINE, [("train", staubli.recording(place, folder))]
    if name == "EMPS":
        made = emps.files(place, folder)
        return emps.MACHINE, [(role, made[role]) for role in emps.ROLES]
    # KUKA LWR: seven joints with torque sensors on the link side; FloBaRoID (LGPL-3.0), 200 Hz.
    return place / "machine.yaml", [(role, place / f"{role}.parquet") for role in emps.ROLES]


def read(name: str, data: Path, folder: Path) -> tuple[Machine, list[Recording]] | None:
    """Read the same."""
    found = files(name, data, folder)
    if found is None:
        return None
    machine = load_machine(found[0])
    return machine, [read_recording(path, machine, role) for role, path in found[1]]


def session(name: str, data: Path, folder: Path, *, loop: bool = False) -> Session | None:
    """Make a session with something to predict, with default options but for the loop; None without data."""
    found = read(name, data, folder)
    if found is None:
        return None
    machine, recordings = found
    parts = cut(recordings[0], FITTED) if name == "TX40" else tuple(recordings)
    return Session(machine, parts, Options(loop=loop))


def swapped(train: Recording, validate: Recording) -> list[Recording]:
    """Exchange the roles of two motions."""
    return [replace(validate, role="train"), replace(train, role="validate")]


def cut(recording: Recording, share: float) -> tuple[Recording, Recording]:
    """Cut a recording into a training part, up to a share of its length, and one to predict."""
    row = round(share * len(recording))

    def part(role: str, rows: slice) -> Recording:
        return replace(recording.cut(rows), role=role, sha256=f"{recording.sha256}-{role}")

    return part("train", slice(0, row)), part("validate", slice(row, None))
