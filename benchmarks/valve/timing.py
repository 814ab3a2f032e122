"""How long an identification takes: twelve recordings of 50 s of a crane with two valves, on one core."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from benchmarks.targets import Outcome, figure
from benchmarks.valve.drawing import ValveKey, order_of
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from fitting.valve.identify import identify_valves
from sim_backends.valve.motion import Phase, valve_motion, working_motion
from sim_backends.valve.recording import simulate_valve_case, write_valve_case

RECORDINGS, SECONDS = 12, 50.0
MOST = 20.0  # s of processor time


def timed(seed: int) -> Outcome:
    """Identify a healthy crane with the loop: a third of the recordings are motions of one valve, the others work.

    One more recording is judged on.
    """
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        _record(folder, seed)
        machine = load_machine(folder / "machine.yaml")
        whole = [read_recording(path, machine, "train") for path in sorted(folder.glob("train-*.parquet"))]
        recordings = [own.cut(slice(0, round(SECONDS * machine.rate_hz))) for own in whole]
    started = process_time()
    found = identify_valves(machine, recordings[:RECORDINGS], recordings[RECORDINGS:])
    took = process_time() - started
    errors = {name: axis["errors"]["handed_out"] for name, axis in found.report["axes"].items()}
    name = f"{RECORDINGS} recordings of {SECONDS:g} s, {len(errors)} axes, with the loop: processor time"
    return Outcome((figure(name, took, "{:.1f} s", most=MOST),), ("",), {"seconds": took, "errors": errors})


def _record(folder: Path, seed: int) -> None:
    machine, truth, _, guesses, _, quality, noise = order_of(ValveKey(1, "null", seed))
    rng, count = np.random.default_rng([81, seed]), len(machine.joints)
    programmes: dict[str, list[Phase]] = {}
    for number in range(RECORDINGS + 1):
        if number % 3:
            phases = working_motion(guesses, rng, SECONDS + 10.0, float(rng.uniform(0.5, 0.8)))
        else:
            poses = [(0.5,) * count, tuple(rng.uniform(0.2, 0.8, count).tolist())]
            phases = valve_motion(number // 3 % count, guesses, poses, 0.7)
        programmes[f"train-{number:02d}"] = phases
    write_valve_case(folder, simulate_valve_case(machine, truth, programmes, guesses, quality=quality, seed=noise))
