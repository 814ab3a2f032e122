"""All cases of a run, and how long an identification takes: twelve recordings of 50 s of a crane, on one core."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np

from benchmarks.cases import append, resumed
from benchmarks.targets import Check, Outcome, Show, figure
from benchmarks.valve.drawing import CLASSES, ValveKey, order_of, stored_cases
from benchmarks.valve.judging import identified
from benchmarks.valve.scoring import Line, case_text, checks, followed, scored
from daq.errors import InputError
from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from fitting.valve.identify import identify_valves
from sim_backends.valve.motion import Phase, valve_motion, working_motion
from sim_backends.valve.recording import simulate_valve_case, write_valve_case

RECORDINGS, SECONDS = 12, 50.0
MOST = 20.0  # s of processor time


def run(
    count: int, seed: int, cache: Path | None, only_make: bool, output: Path | None, closed_loop: int, healthy: bool,
    show: Show,
) -> Outcome:  # fmt: skip
    """Make, identify and score ``count`` machines, each healthy and (but with ``healthy``) with one effect.

    Raises
    ------
    InputError
        If a cache is to be filled and none is named, or ``output`` holds something else.
    """
    if only_make and cache is None:
        raise InputError("--only-make: fills a cache; name it with --cache")
    keys = [ValveKey(number, made, seed) for number in range(count) for made in CLASSES[: 1 if healthy else 2]]
    known = {} if only_make else {line["case"]: line for line in resumed(output, {"case", "axes"}, "valve")}
    lines: list[Line] = []
    with TemporaryDirectory() as temporary:
        folders = stored_cases(cache or Path(temporary), keys, show)
        if only_make:
            return Outcome((), (f"{len(folders)} cases in {cache}", ""), {})
        for key, folder in zip(keys, folders, strict=True):
            line = known.get(key.text)
            if line is None:
                answer = identified(folder)
                line = scored(folder, answer)
                if key.made == "null" and key.number < closed_loop:
                    line["followed"] = followed(folder, key, answer)
                append(output, line)
            show(case_text(line))
            lines.append(line)
    mean = float(np.mean([line["seconds"] for line in lines]))
    took = figure("processor time of an identification, mean", mean, "{:.1f} s")
    return Outcome((*checks(lines), *_followed(lines), took), ("",), {"cases": lines})


def _followed(lines: list[Line]) -> list[Check]:
    shares = [100.0 * own["preview"] / own["linear"] for line in lines if (own := line.get("followed"))]
    if not shares:
        return []
    middle = float(np.median(shares))
    name, shown = "tracking error by inverse and preview over linear feedforward's, median", f"{middle:.0f} % (worst "
    return [figure(name, middle, "{} %", most=25.0, shown=f"{shown}{max(shares):.0f} %)")]


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
