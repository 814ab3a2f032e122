"""What a fit of the simulated machine leaves ambiguous: its designed motion is recorded and all is fitted again.

On a real machine a person would have to load the motion, so there the report says what to record and nothing waits.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from server.jobs.job_kinds import JobError
from server.platform.errors import UnavailableError
from server.recalibrations.recalibration_recording import MARGIN_S, Scene, Wanted, make
from server.recalibrations.recalibration_store import Recalibration

#: Motions that are made at most, and the probability at which one explanation is enough.
MOST_MOTIONS, ENOUGH = 2, 0.95
#: Where the fit leaves the motion that it designed (:data:`fitting.pipeline.stage_names.NEXT_MOTION`).
MOTION = "next-experiment.csv"


def asked_for(results: Path) -> tuple[Path, str, float] | None:
    """The motion that a report asks for: its file, the role of its recording and its seconds; None if it asks none.

    Parameters
    ----------
    results : directory of an identification that is done
    """
    loop = json.loads((results / "report.json").read_bytes())["loop"]
    experiment, hypotheses = loop.get("next_experiment"), loop.get("hypotheses") or []
    if not isinstance(experiment, dict) or not experiment.get("motion_file") or not experiment.get("seconds"):
        return None
    if not hypotheses or hypotheses[0]["probability"] >= ENOUGH:
        return None
    role = "unloaded" if experiment.get("rods") == "unpinned" else "train"
    return results / MOTION, role, float(experiment["seconds"])


def resolved(
    scene: Scene,
    this: Recalibration,
    identified: str,
    results: Callable[[str], Path],
    identify: Callable[[dict[str, tuple[str, str]]], str | None],
) -> str | None:
    """The last identification, once nothing is asked for any more or two motions were made; None if told to stop.

    Parameters
    ----------
    scene : where recordings are made
    this : the recalibration with its recordings
    identified : id of the first identification, which is done
    results : gives the directory of an identification
    identify : identifies with these recordings more (id and role by key) and waits; the id, None if told to stop

    Where a motion cannot be recorded, what was identified before it stays.

    Raises
    ------
    JobError
        If a fit fails.
    """
    controller = scene.machines.controller(this.machine)
    found, more, last = dict(this.recordings), dict[str, tuple[str, str]](), identified
    for number in range(1, MOST_MOTIONS + 1):
        asked = None if controller is None else asked_for(results(last))
        if controller is None or asked is None:
            break
        motion, role, seconds = asked
        key = f"resolve-{number}"

        def send(name: str, motion: Path = motion, controller: Any = controller) -> None:
            controller.send_file(name, motion)

        def said(fraction: float, text: str) -> None:
            scene.run.progress(fraction, f"To tell explanations apart: {text}")

        try:
            made = make(scene, this, found, Wanted(key, role, seconds - MARGIN_S, send), said)
        except (JobError, UnavailableError) as error:
            said(1.0, f"not recorded, the fit stays as it is: {error}")
            break
        if not made:
            return None
        more[key] = found[key], role
        again = identify(dict(more))
        if again is None:
            return None
        last = again
    return last
