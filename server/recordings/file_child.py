"""Work on files from outside, each in a process of its own with limits.

``python -P -m server.recordings.file_child inspect FILE MACHINE_FILE ROLE`` or
``... convert WHAT SOURCE TARGET MACHINE_FILE SHOWN``, then more of the same orders on standard input.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from server.platform.processes import forking_child
from server.recordings import inspect_recording
from server.recordings.formats import conversion_child

#: Entries by the first argument.
WORK = {"inspect": inspect_recording.main, "convert": conversion_child.main}


def work(arguments: Sequence[str]) -> int:
    """Do one piece of work in this process; the exit code."""
    what, *rest = arguments
    return WORK[what](rest)


if __name__ == "__main__":
    sys.exit(forking_child.serve(work, sys.argv[1:]))
