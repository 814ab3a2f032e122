"""``python -m server.excitations.excitation_child REQUEST.json``: design a motion.

It speaks as :mod:`server.platform.processes.children` says.

``motion.csv`` first, ``result.json`` last, each whole or not at all: where the result is, the design is done.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine, load_machine
from daq.messages import Sentence
from daq.motion_files import Motion, write_motion
from daq.whole_files import write_whole
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.geometry import geometry_of
from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion
from fitting.excitation.design import design_motion
from fitting.excitation.limits import limits_of_machine
from fitting.excitation.problem import ExcitationOptions
from fitting.planning.guess import USUAL_SUPPLY, default_guess, worst_friction
from server.platform.processes.child_speech import ended, send

Progress = Callable[[float, float], None]
_LITRES_PER_MINUTE = 1e-3 / 60  # m^3/s
_BAR = 1e5  # Pa


def _design(machine: Machine, options: dict[str, Any], progress: Progress) -> tuple[Motion, dict[str, Any]]:
    """Design the motion and its summary.

    Parameters
    ----------
    options : ``rods``, ``joints``, ``duration_s``, ``seed``, ``starts``, ``use``, ``max_frequency_hz``,
        ``max_flow_l_min``, ``max_pressure_bar``; None or absent: the usual value
    progress : takes the share that is done, and the condition number so far
    """
    joints = tuple(options.get("joints") or ()) or None
    seed = int(options.get("seed") or 0)
    common = {
        name: options[key]
        for name, key in (("seconds", "duration_s"), ("use", "use"), ("starts", "starts"))
        if options.get(key) is not None
    }
    flow, pressure = options.get("max_flow_l_min"), options.get("max_pressure_bar")
    base = reduce_parameters(geometry_of(machine).uncoupled())
    supply = None if machine.hydraulics is None else machine.hydraulics.supply_pressure
    guess = default_guess(machine, base, supply or USUAL_SUPPLY)
    limits = limits_of_machine(
        machine,
        guess.base,
        worst_friction(machine, guess),
        flow=None if flow is None else flow * _LITRES_PER_MINUTE,
        pressure=None if pressure is None else pressure * _BAR,
    )
    if options.get("rods") == "unpinned":
        free = design_cylinder_motion(
            machine,
            seed=seed,
            options=replace(CylinderOptions(), **common),
            joints=joints,
            flow=limits.flow,
            progress=progress,
        )
        return free.motion, {
            "condition_number": max(free.condition_numbers.values()),
            "limits": [asdict(limit) for limit in free.limits],
            "not_told": [],
        }
    if options.get("max_frequency_hz") is not None:
        common["max_frequency"] = options["max_frequency_hz"]
    found = design_motion(
        machine,
        base,
        seed=seed,
        options=replace(ExcitationOptions(), **common),
        joints=joints,
        hydraulic=limits,
        progress=progress,
    )
    return found.motion, {
        "condition_number": found.condition_number if np.isfinite(found.condition_number) else None,
        "limits": [asdict(limit) for limit in found.limits],
        "not_told": list(found.undetermined),
    }


def _run(request: Path) -> dict[str, Any]:
    """Design what ``request`` asks for, unless it is there already; return the result."""
    content = json.loads(request.read_text(encoding="utf-8"))
    output = Path(content["output"])
    result_file = output / "result.json"
    if result_file.is_file():
        return dict(json.loads(result_file.read_text(encoding="utf-8")))

    def progress(share: float, _condition: float) -> None:
        send(fraction=share, text=Sentence("server.designing_motion"))

    motion, result = _design(load_machine(content["machine"]), content["options"], progress)
    write_motion(output / "motion.csv", motion)
    result |= {"seconds": motion.seconds, "rods": motion.rods, "joints": list(motion.columns)}
    write_whole(result_file, json.dumps(result, allow_nan=False).encode())
    return result


def main(arguments: list[str]) -> int:
    """Run as a program; the exit code."""
    return ended(lambda: _run(Path(arguments[0])))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
