"""``hilfit demo --valve``: a crane's valves on simulated buses, from planned commands to an inverse that was tested.

The crane's own controller plays the planned valve motions; what it sends is seen on the bus like any other value. What
its valves have that the model lacks is known to the plant alone.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from daq.whole_files import write_whole
from server.commands.demo_command import Acquired, Progress, alone_in, save_motion

if TYPE_CHECKING:
    from daq.acquisition.acquisition import AcquisitionProcess
    from daq.acquisition.recorder import RecordingSummary
    from sim_backends.simulated_machine import SimulatedMachine

#: Share of the progress bar that recording takes, after some planning.
_RECORD = (0.03, 0.8)


def run_valve_demo(
    output: Path,
    undeclared: Sequence[str] | None = None,
    seconds: float = 40.0,
    speed: float = 4.0,
    seed: int = 1,
    progress: Progress = lambda share, text: None,
) -> tuple[dict[str, Any], Acquired, list[str]]:
    """Run the demo; return the report, what was acquired, and results of the exported inverses' self-tests.

    Parameters
    ----------
    output : directory; gets ``motions/``, ``recordings/``, ``machine/``, ``valve.json`` and ``inverse/``
    undeclared : ``EFFECT:FORM:JOINT:SIZE`` texts; None lets the plant choose its own, ``["none"]`` gives healthy valves
    seconds : length of the motion that is judged on, in machine time
    speed : machine seconds per second
    seed : of the plant's noise and of that motion
    progress : called with the share done and what is being done
    """
    from daq.acquisition.acquisition import AcquisitionProcess
    from fitting.arm.base_parameters import reduce_parameters
    from fitting.excitation.design import design_motion
    from fitting.excitation.problem import ExcitationOptions
    from fitting.loop.session import Request
    from fitting.pipeline.stages import require_writable
    from fitting.pipeline.valve_stage import identified_and_written
    from fitting.valve.motion import plan_valve_motions, written_plan
    from sim_backends.simulated_machine import SimulatedMachine
    from sim_backends.valve.effects import parse_valve_spec
    from sim_backends.valve.machines import default_crane

    machine, _ = default_crane()
    require_writable(output)
    specs = None if undeclared is None else [parse_valve_spec(text) for text in undeclared if text != "none"]
    simulated = SimulatedMachine(machine, None, "demo" if specs is None else specs, seed, speed, output / "machine")
    with alone_in(output):
        progress(0.0, "planning the valve motions")
        lengths = {}
        for planned in plan_valve_motions(machine):
            written_plan(planned, output / "motions")
            lengths[planned.name] = planned.seconds
        options = ExcitationOptions(seconds=seconds, starts=1, iterations=40)
        judged = design_motion(machine, reduce_parameters(machine), seed=seed, options=options).motion
        save_motion(output / "motions" / "validate.csv", judged)
        lengths["validate"] = judged.seconds
        first, last = _RECORD
        done, recorded = 0.0, []
        with simulated, AcquisitionProcess(simulated.machine_path) as acquisition:
            for name, length in lengths.items():

                def shown(now: float, done: float = done, name: str = name) -> None:
                    progress(first + (last - first) * (done + now) / sum(lengths.values()), f"recording {name}")

                path = output / "recordings" / f"{name}.parquet"
                role = "validate" if name == "validate" else "operation"
                motion = output / "motions" / f"{name}.csv"
                recorded.append((role, path, _record_played(simulated, acquisition, motion, role, path, shown)))
                done += length
        request = Request(simulated.machine_path, tuple((role, path) for role, path, _ in recorded), output)
        report, files = identified_and_written(
            request, ("c", "csv", "st"), lambda share, text: progress(last + (1.0 - last) * share, text)
        )
    tests = [_self_tested(file) for file in files if file.name.endswith("_selftest.c")]
    return report, Acquired.of(recorded, machine.rate_hz), tests


def _record_played(
    simulated: SimulatedMachine,
    acquisition: AcquisitionProcess,
    motion: Path,
    role: str,
    path: Path,
    shown: Callable[[float], None] = lambda seconds: None,
) -> RecordingSummary:
    """Play a file on the controller, and record from when it begins until it is over."""
    from daq.acquisition.recorder import Recorder

    write_whole(simulated.inbox / motion.name, motion.read_bytes())
    simulated.wait_following(motion.stem)
    recorder = Recorder(acquisition.ring_name, acquisition.machine, role, path, overwrite=True)
    recorder.start(progress=lambda rows, _: shown(rows / acquisition.machine.rate_hz))
    try:
        simulated.wait_done(motion.stem, timeout=3600.0)
    finally:  # interrupted, too: what was recorded until then is sealed
        summary = recorder.stop()
    acquisition.check()
    return summary


def _self_tested(source: Path) -> str:
    """Compile and run an exported self-test; return its line for people."""
    compiler = shutil.which("cc")
    if compiler is None:
        return f"self-test {source}: not run, there is no C compiler (cc) here"
    with TemporaryDirectory(prefix="hilfit-") as folder:
        program = Path(folder) / "selftest"
        sources = [str(source).replace("_selftest.c", ".c"), str(source)]
        subprocess.run([compiler, "-std=c99", "-O2", *sources, "-lm", "-o", str(program)], check=True)
        done = subprocess.run([program], capture_output=True, text=True, check=False)
    return f"self-test {source}: {'passed' if done.returncode == 0 else 'FAILED'}, {done.stdout.strip()}"
