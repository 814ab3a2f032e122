"""The identification of valves as one stage: recordings in roles, the report, and the inverses for controllers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from daq.machine.machine_file import load_machine
from daq.recordings.column_map import load_map
from daq.recordings.recording import read_recording
from daq.whole_files import replacing
from fitting.loop.session import Request
from fitting.pipeline.stage_names import INVERSES, VALVE_REPORT
from fitting.progress import Progress, quiet
from fitting.valve.export import export_valve
from fitting.valve.identify import identify_valves


def identified_and_written(
    request: Request, to: Sequence[str], progress: Progress = quiet
) -> tuple[dict[str, Any], list[Path]]:
    """Identify the valves of a request, and write inverses in the formats ``to``, then the report.

    Recordings of the role ``validate`` are judged on, all others fitted. Of the options ``loop``, ``bandwidth_hz``,
    ``columns`` and ``resample`` count. Gives the report and the inverses' paths; a valve that never moved has none.

    Raises
    ------
    InputError
        One line about the machine file or a recording.
    """
    machine, options = load_machine(request.machine), request.options
    columns = None if options.columns is None else load_map(Path(options.columns), machine)
    recordings = [
        (role, read_recording(path, machine, role, columns=columns, resample=options.resample))
        for role, path in request.recordings
    ]
    found = identify_valves(
        machine,
        [own for role, own in recordings if role != "validate"],
        [own for role, own in recordings if role == "validate"],
        bandwidth_hz=options.bandwidth_hz,
        loop=options.loop,
        progress=progress,
    )
    request.output.mkdir(parents=True, exist_ok=True)
    moved, folder = [own for own in found.models.values() if own.moves], request.output / INVERSES
    written = [path for own in moved for name in to for path in export_valve(own, name, folder).files]
    with replacing(request.output / VALVE_REPORT) as temporary:
        temporary.write_text(json.dumps(found.report, indent=1) + "\n", encoding="utf-8")
    return found.report, written
