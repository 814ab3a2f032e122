"""The demonstration, timed: the whole path over simulated buses, and what it has to reach.

Targets: no cycle missing and every value fresh; 50.0 Hz in machine time; the effect that only the plant knows is named
at joint2; the error of joint2 on the validation motion at least halved; run as it comes, the numbers of README.md but
for what two runs differ by. The rate is measured against the motion that
the simulated controller followed by its own clock, because the time stamps of a lockstep simulation are cycle numbers
over 50 by construction. The wall time is printed (two minutes on two idle cores is what it is meant to take) and is no
target: it depends on what else the computer does.

``python -m benchmarks.demonstration`` (``make readme``) runs ``hilfit demo`` and ``hilfit demo --valve`` in temporary
folders and writes what they print into README.md; a test compares words and numbers.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import textwrap
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.targets import Check, Outcome, fact, figure
from daq.machine.machine_file import load_machine
from daq.motion_files import read_motion
from daq.recordings.recording import read_recording
from fitting.arrays import FloatArray
from server.commands.demo_command import run_demo

#: The demo's own seed and length of each recording in machine time, s.
USUAL = (1, 40.0)
#: What two runs may differ by: acquisition falls on other moments of the simulated noise each time.
APART = 0.15
#: N m; smaller errors may differ by that share of this.
SMALL = 0.3
README = Path(__file__).parents[1] / "README.md"
_BLOCK = re.compile(r"(?<=^```\n)acquired .*?(?=^```$)", re.MULTILINE | re.DOTALL)
_VALVES = re.compile(r"(?<=^```\n) +error over the speed's RMS.*?(?=^```$)", re.MULTILINE | re.DOTALL)
_WIDTH = 120


def _cycles_per_machine_second(output: Path) -> float:
    """Compute the rate of the validation recording by the controller's clock.

    The recorded angle is laid over the motion file's, ``q(t) = q_file(scale t + shift)``; the scale times the stamped
    rate is the rate. The controller's tracking error (about 1 mrad) leaves the scale uncertain by some 1e-4.
    """
    machine = load_machine(output / "machine" / "machine.yaml")
    recording = read_recording(output / "recordings" / "validate.parquet", machine, "validate")
    motion = read_motion(output / "motions" / "validate.csv", machine)
    angle, stamps = recording.values["joint1.angle"], recording.time - recording.time[0]

    def apart(x: FloatArray) -> FloatArray:
        return np.asarray(angle - np.interp(x[0] * stamps + x[1], motion.time, motion.columns["joint1"]))

    scale = least_squares(apart, [1.0, 0.0], x_scale=[1e-3, 0.02]).x[0]
    return float((len(stamps) - 1) / (scale * stamps[-1]))


def beside_readme(report: Mapping[str, Any]) -> float:
    """Return the largest share by which floors and errors of joints are other than README.md prints them."""
    errors = report["errors"].values()
    own = [n for e in errors for n in (e["noise_floor"], e["before"]["validate"], e["after"]["validate"])]
    printed = np.array(numbers(printed_result()))
    return float(np.max(np.abs(own - printed) / np.maximum(printed, SMALL)))


def demonstration(seed: int, seconds: float) -> Outcome:
    """Run the demo into a temporary directory."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="hilfit-demo-") as name:
        output = Path(name)
        report, acquired = run_demo(output, seconds=seconds, seed=seed)
        wall = time.perf_counter() - started
        rate = _cycles_per_machine_second(output)
    error = report["errors"]["joint2"]
    before, after = error["before"]["validate"], error["after"]["validate"]
    loop = report["loop"]
    named = [(effect["id"], effect["joint"]) for effect in loop["effects"]]
    shown = f"{before:.2f} to {after:.2f} {error['unit']}, ratio {after / before:.2f}"
    return Outcome(
        (
            figure("wall time of the whole demonstration", wall, "{:.0f} s"),
            Check("cycles missing", float(acquired.missed_cycles), f"{acquired.missed_cycles} of {acquired.rows}",
                  "at most", 0.0, "none"),
            Check("values not fresh", float(acquired.not_fresh), f"{acquired.not_fresh}", "at most", 0.0, "none"),
            figure("rate off 50 Hz in machine time", abs(rate - 50.0), "{:g} Hz", most=0.05, shown=f"{rate:.2f} Hz"),
            fact("the effect at its joint, alone", named == [("position_dependent_friction", "joint2")],
                 f"{loop['verdict']}: {', '.join(f'{e}@{j}' for e, j in named) or 'nothing'}"),
            figure("joint2 on validate, after over before", after / before, most=0.5, shown=shown),
            figure("off README.md's numbers, share", beside_readme(report), "{:.3f}",
                   most=APART if (seed, seconds) == USUAL else None),
        )
    )  # fmt: skip


def printed_result() -> str:
    """Return the block of README.md."""
    (found,) = _BLOCK.findall(README.read_text(encoding="utf-8"))
    return str(found)


def shown_by_the_demo(printed: str) -> str:
    """Extract from ``hilfit demo``'s output what was acquired, the first table, and the verdict."""
    lines = printed.splitlines()
    first = lines[: next(number for number, line in enumerate(lines) if line.startswith("└")) + 1]
    (verdict,) = (line for line in lines if line.startswith("The model lacked"))
    return "\n".join(line.rstrip() for line in (*first, *textwrap.wrap(verdict, _WIDTH))) + "\n"


def _shown_of_valves(printed: str) -> str:
    """Extract from ``hilfit demo --valve``'s output errors, findings, and the self-tests."""
    lines = printed.splitlines()
    first = next(number for number, line in enumerate(lines) if "error over the speed's RMS" in line)
    return "\n".join(line.rstrip() for line in lines[first:] if not line.startswith("report:")) + "\n"


def numbers(result: str) -> list[float]:
    """Read each joint's noise floor and errors before and after, in the order of the table."""
    rows = re.findall(r"^│ \w+ +│ N m +│ ([\d.]+) +│ ([\d.]+) +│ ([\d.]+) +│", result, re.MULTILINE)
    return [float(number) for row in rows for number in row]


def main() -> None:
    """Run the demonstrations and write their results into README.md."""
    for more, block, extract in (([], _BLOCK, shown_by_the_demo), (["--valve"], _VALVES, _shown_of_valves)):
        with tempfile.TemporaryDirectory(prefix="hilfit-readme-") as folder:
            command = [sys.executable, "-m", "server.commands.command_line", "demo", *more]
            environment = {**os.environ, "COLUMNS": "80"}
            done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True, env=environment)
        result = extract(done.stdout)
        text = README.read_text(encoding="utf-8")
        README.write_text(block.sub(lambda _, result=result: result, text), encoding="utf-8")  # type: ignore[misc]
        print(result, end="")


if __name__ == "__main__":
    main()
