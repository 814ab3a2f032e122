"""``python -m server.recalibrations.comparison_child REQUEST.json``: what two calibrations leave over of one recording.

The request names the models of both identifications and, for each, the recordings to look at. Speaks as
:mod:`server.platform.processes.children` says; its summary is that of
:func:`server.recalibrations.recalibration_comparison.table`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daq.arrays import FloatArray
from daq.errors import InputError
from daq.recordings.recording import read_recording
from server.identifications.live_model import LiveModel
from server.platform.processes.child_speech import ended
from server.recalibrations.recalibration_comparison import table


def _residuals(model: LiveModel, recordings: Sequence[Path]) -> tuple[FloatArray, ...]:
    """Compute every joint's residual where its drive moves, through the identification filter, N m or N.

    Raises
    ------
    InputError
        If a recording has a gap, or is shorter than the filters.
    """
    parts: list[list[FloatArray]] = [[] for _ in model.machine.joints]
    for path in recordings:
        recording = read_recording(path, model.machine, "operation")
        rows = (len(recording.time) - model.overlap) // model.bank.decimation
        if rows < 5:
            raise InputError("server.too_short_compare_calibrations", path=path.name)
        use = slice(0, model.overlap + rows * model.bank.decimation)
        values = {name: column[use] for name, column in recording.values.items()}
        blocks = model.evaluate(recording.time[use], values)
        if blocks is None:
            raise InputError("server.gaps_calibrations_cannot_compared", path=path.name)
        for part, block in zip(parts, blocks, strict=True):
            part.append(block.residual[block.moving])
    return tuple(np.concatenate(part) for part in parts)


def _rms(residual: FloatArray) -> float:
    """Compute the root mean square; 0 where nothing moved."""
    return float(np.sqrt(np.mean(residual**2))) if len(residual) else 0.0


def _run(request: Path) -> dict[str, Any]:
    """Compare what ``request`` names."""
    content = json.loads(request.read_text(encoding="utf-8"))
    active, new = (LiveModel.load(Path(content[name]["model"])) for name in ("active", "new"))
    judged = [Path(path) for path in content["new"]["recordings"]]
    own = [Path(path) for path in content["active"]["recordings"]]
    names = [joint.name for joint in new.machine.joints]

    def by_joint(model: LiveModel, recordings: Sequence[Path]) -> dict[str, float]:
        return dict(zip(names, (_rms(each) for each in _residuals(model, recordings)), strict=True))

    units = {joint.name: joint.effort_unit for joint in new.machine.joints}
    return table(by_joint(active, judged), by_joint(new, judged), by_joint(active, own) if own else {}, units)


def main(arguments: list[str]) -> int:
    """Run as a program; the exit code."""
    # Whatever was wrong, it is a reason why these two cannot be compared.
    return 2 if ended(lambda: _run(Path(arguments[0]))) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
