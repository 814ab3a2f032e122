"""The OpenAPI description as a file, by default ``docs/openapi.json``.

``python -m server.commands.openapi_file [FILE]`` writes it.

Clients are made from that file, so it is committed, and a test fails when the service says something else: whoever
changes the interface writes the file anew and shows the difference to who reviews it.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from server.composition.app import create_app
from server.composition.declarations import RESOURCES
from server.platform.service import Service
from server.platform.settings import Settings

PLACE = Path(__file__).parents[2] / "docs" / "openapi.json"


def describe() -> dict[str, Any]:
    """Describe a service with default settings; nothing of it is started."""
    with tempfile.TemporaryDirectory() as directory:
        service = Service(Settings(data_dir=Path(directory)), RESOURCES)
        try:
            return create_app(service).openapi()
        finally:
            service.stop()


def text_of(description: dict[str, Any]) -> str:
    """Write the file's text: sorted, so that a difference is a change."""
    return json.dumps(description, indent=1, sort_keys=True) + "\n"


def main(arguments: list[str]) -> int:
    """Write the file."""
    place = Path(arguments[0]) if arguments else PLACE
    place.write_text(text_of(describe()), encoding="utf-8")
    print(f"wrote {place}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
