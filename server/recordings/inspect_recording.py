"""Look at an uploaded recording, in a process of its own (:mod:`server.platform.processes.file_children`).

A file from outside may be hostile; reading it must not cost the process that serves HTTP more than a child.
Speaks the protocol of :mod:`server.platform.processes.children`.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import scipy.signal  # noqa: F401  # what checks use of scipy: loaded once, not again in the fork of every file

from daq import InputError, Machine, Recording, load_machine, read_recording
from daq.messages import Sentence, message_of
from fitting.checks.check import check_recordings
from fitting.checks.findings import Places
from fitting.pipeline.check_gate import explained, for_report
from server.platform.processes.child_limits import RECORDING_CPU_S, limit_child
from server.platform.processes.child_speech import ended
from server.recordings.formats.declared_size import refuse_bombs


def findings_on(machine: Machine, recording: Recording, machine_file: Path) -> list[dict[str, Any]]:
    """Check one recording alone; nothing if that fails: an upload must not fail for it."""
    try:
        found = check_recordings(machine, [recording], places=Places.of(machine_file))
    except Exception as error:
        print(f"the checks failed: {error!r}", file=sys.stderr)
        return []
    content = for_report(found)
    # The file has another name here than the one that people know it by.
    shown = [{**own, "recording": None, "text": _without(recording.file, own["text"])} for own in content]
    return [own | {f"{name}_message": message_of(own[name]) for name in ("text", "cure")} for own in shown]


def _without(file: str, text: str) -> str:
    """Return a finding's text without the file's name in front."""
    if isinstance(text, Sentence) and text.code == "daq.named" and text.values["name"] == file:
        return str(text.values["what"])
    return text


def look(recording_file: Path, machine_file: Path, role: str) -> dict[str, Any]:
    """Summarise the file; InputError if it is no good recording."""
    try:
        machine = load_machine(machine_file)
        refuse_bombs(recording_file, str(recording_file))
        recording = read_recording(recording_file, machine, role)
    except InputError as error:
        raise explained(error, machine_file, [(role, recording_file)]) from None
    statistics = {
        "rows": len(recording),
        "seconds": round(recording.duration, 6),
        "rate_hz": recording.rate_hz,
        "missing_rows": len(recording) - sum(part.stop - part.start for part in recording.segments()),
        "segments": len(recording.segments()),
        "findings": findings_on(machine, recording, machine_file),
    }
    return {"sha256": recording.sha256, "statistics": statistics}


def main(arguments: Sequence[str]) -> int:
    """Run :func:`look`, of ``FILE MACHINE_FILE ROLE``, with this process limited to what such a file may take."""
    file, machine_file, role = arguments
    limit_child(RECORDING_CPU_S, Path(file).stat().st_size)
    too_much = Sentence("server.needs_too_much_memory", file=file)
    return ended(lambda: look(Path(file), Path(machine_file), role), too_much)
