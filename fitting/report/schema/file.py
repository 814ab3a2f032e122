"""The JSON schema of ``report.json`` as a file, by default ``docs/report.schema.json``.

``python -m fitting.report.schema.file [FILE]`` writes it. The page's types are made of that file, so it is committed,
and a test fails when the definition says something else.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from fitting.report.schema.definition import json_schema

PLACE = Path(__file__).parents[3] / "docs" / "report.schema.json"


def text() -> str:
    """Write the file's text: sorted, so that a difference is a change."""
    return json.dumps(json_schema(), indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    (Path(sys.argv[1]) if len(sys.argv) > 1 else PLACE).write_text(text(), encoding="utf-8")
