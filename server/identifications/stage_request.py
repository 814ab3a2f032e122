"""The program that a job's stages run in, and what it is told.

By default it is ``python -P -m fitting.pipeline.stage_program --stay REQUEST.json STAGE``, which never runs in the
process that serves HTTP, and stays for the stages that follow.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from daq.whole_files import write_whole
from fitting.pipeline.stage_names import STAGES, VALVE_WORDS, WORDS, ReportLanguage


@dataclass(frozen=True)
class StageProgram:
    """Stages in order, and the command that runs one: ``[*command, REQUEST.json, STAGE]``."""

    stages: tuple[str, ...]
    command: tuple[str, ...]


@dataclass(frozen=True)
class StageRequest:
    """What every stage of one identification is told: files by their paths, recordings with their roles.

    The report's page is written in every language.
    """

    machine: Path
    recordings: tuple[tuple[str, Path], ...]
    options: dict[str, Any]
    output: Path

    def write(self) -> Path:
        """Write it to ``request.json`` in the output directory; returns its path."""
        content = {
            "machine": str(self.machine),
            "recordings": [[role, str(path)] for role, path in self.recordings],
            "options": self.options,
            "output": str(self.output),
            "languages": get_args(ReportLanguage),
        }
        path = self.output / "request.json"
        write_whole(path, json.dumps(content, indent=1).encode())
        return path


def words(stage: str) -> str:
    """Return what a person reads while ``stage`` runs."""
    text = (WORDS | VALVE_WORDS).get(stage, stage.replace("_", " "))
    return text[:1].upper() + text[1:]


def fitting_program(stages: tuple[str, ...] = STAGES) -> StageProgram:
    """List stages of :mod:`fitting`, which is loaded here only for their names."""
    return StageProgram(stages, (sys.executable, "-P", "-m", "fitting.pipeline.stage_program", "--stay"))
