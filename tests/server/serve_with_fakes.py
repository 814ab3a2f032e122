"""``python serve_with_fakes.py DATA_DIR``: a real server process with fake stages; prints its address."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from service_fakes import ANY_PLACE, Fakes, children_as_important_as_tests

from server.composition.serve import serve
from server.platform.settings import Settings


def ready(url: str) -> None:
    print(json.dumps({"url": url}), flush=True)


if __name__ == "__main__":
    with children_as_important_as_tests():
        serve(Settings(data_dir=Path(sys.argv[1]), port=0, bus_places=ANY_PLACE), ready, Fakes().parts)
