"""Measured machines as files: nothing is wrong with their recordings, whatever rate they are brought to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.measured import emps, staubli
from daq.machine.machine_file import Machine, load_machine

Case = tuple[str, Machine, list[tuple[str, Path]]]


def measured_machines(data: Path, folder: Path) -> Iterator[Case]:
    """Name, machine and recordings by role of every machine that ``data`` has; files are made in ``folder``."""
    roles = ("train", "repeat", "validate")
    if (data / "emps").is_dir():
        paths = emps.files(data / "emps", folder)
        yield "EMPS", load_machine(emps.MACHINE), [(role, paths[role]) for role in roles]
    if (kuka := data / "kuka_lwr4").is_dir():
        yield "KUKA LWR", load_machine(kuka / "machine.yaml"), [(role, kuka / f"{role}.parquet") for role in roles]
    if (data / "staubli_tx40").is_dir():
        path = staubli.recording(data / "staubli_tx40", folder)
        yield "TX40", load_machine(staubli.MACHINE), [("train", path)]
