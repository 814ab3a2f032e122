"""Look at an uploaded recording in a process of its own.

``python -m server.inspect_recording FILE MACHINE_FILE ROLE``

A file from outside may be hostile; reading it must not cost the process that serves HTTP more than a child.
Speaks the protocol of :mod:`server.children`.
"""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path

from daq import InputError, load_machine, read_recording

#: Address space of the child; a recording of the largest upload needs a small part of it.
MAXIMUM_BYTES = 8 * 2**30


def main(recording_file: Path, machine_file: Path, role: str) -> int:
    """Print the summary or the error; returns the exit code."""
    resource.setrlimit(resource.RLIMIT_AS, (MAXIMUM_BYTES, MAXIMUM_BYTES))
    try:
        recording = read_recording(recording_file, load_machine(machine_file), role)
    except InputError as error:
        print(json.dumps({"error": str(error)}))
        return 2
    except MemoryError:
        print(json.dumps({"error": f"{recording_file}: needs too much memory; record or export a shorter one"}))
        return 2
    summary = {
        "rows": len(recording),
        "seconds": round(recording.duration, 6),
        "rate_hz": recording.rate_hz,
        "missing_rows": len(recording) - sum(part.stop - part.start for part in recording.segments()),
        "segments": len(recording.segments()),
    }
    print(json.dumps({"summary": {"sha256": recording.sha256, "statistics": summary}}))
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]))
