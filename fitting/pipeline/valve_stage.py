"""The identification of valves as one stage: recordings in roles, the report, and the inverses for controllers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daq.machine.machine_file import load_machine
from daq.recordings.recording import read_recording
from daq.whole_files import replacing
from fitting.loop.session import Request
from fitting.pipeline.stage_names import INVERSES, VALVE_REPORT, Progress, quiet
from fitting.valve.export import export_valve, formats
from fitting.valve.identify import Identified, identify_valves


def valve_stage(request: Request, progress: Progress = quiet) -> dict[str, Any]:
    """Identify the valves of a request, write all that there is of them, and say which files those are.

    Recordings of the role ``validate`` are judged on, all others fitted. Of the options ``loop`` and ``bandwidth_hz``
    count.

    Raises
    ------
    InputError
        One line about the machine file or a recording.
    """
    machine = load_machine(request.machine)
    recordings = [(role, read_recording(path, machine, role)) for role, path in request.recordings]
    found = identify_valves(
        machine,
        [own for role, own in recordings if role != "validate"],
        [own for role, own in recordings if role == "validate"],
        bandwidth_hz=request.options.bandwidth_hz,
        loop=request.options.loop,
        progress=progress,
    )
    written = write_valves(found, request.output, tuple(formats()))
    return {"inverses": [path.name for path in written]}


def write_valves(found: Identified, output: Path, to: Sequence[str]) -> list[Path]:
    """Write inverses in some formats, then the report; the inverses' paths. A valve that never moved has none."""
    output.mkdir(parents=True, exist_ok=True)
    moved = [model for model in found.models.values() if model.moves]
    written = [path for model in moved for name in to for path in export_valve(model, name, output / INVERSES).files]
    with replacing(output / VALVE_REPORT) as temporary:
        temporary.write_text(json.dumps(found.report, indent=1) + "\n", encoding="utf-8")
    return written
