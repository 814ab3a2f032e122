"""``python work_with_fakes.py DATA_DIR DATABASE_URL NAME``: a real worker process with fake stages."""

from __future__ import annotations

import sys
from pathlib import Path

from service_fakes import Fakes, children_as_important_as_tests

from server.composition.worker import work
from server.platform.settings import Settings

if __name__ == "__main__":
    settings = Settings(data_dir=Path(sys.argv[1]), database_url=sys.argv[2])
    with children_as_important_as_tests():
        work(settings, sys.argv[3], lambda: print("ready", flush=True), Fakes().parts)
