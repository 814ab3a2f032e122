"""KUKA LWR: seven joints with torque sensors on the link side; another motion is predicted.

Data: FloBaRoID (LGPL-3.0), 200 Hz, the same motion twice and another one; machine file beside it. Published for another
motion: 13.2 %.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.measured.ways import Ways, ways
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from fitting.loop.session import Session

#: Relative error on the other motion, percent: of the base model at most, and with what the loop added.
MOST_BASE, MOST_AFTER = 4.4, 4.4


def evaluate(data: Path) -> Ways:
    """Both stages and the loop on the recordings as they are."""
    machine = load_machine(data / "machine.yaml")
    roles = ("train", "repeat", "validate")
    return ways(
        "KUKA LWR", Session(machine, [read_recording(data / f"{role}.parquet", machine, role) for role in roles])
    )
