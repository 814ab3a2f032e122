"""``python serve_with_set_clock.py DIRECTORY``: the real service with access control and a simulated machine.

The machine is the demonstration's with three joints, not six.

Its schedules' clock starts at five minutes past the hour, whatever the computer's, and is ``DIRECTORY/hours`` later, so
that a test neither waits for a slot nor has one that it did not ask for.
Stages have the priority of everything else here: beside other tests the lowest one is next to nothing.
"""

from __future__ import annotations

import json
import sys
from datetime import datetime, timedelta
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "daq"))

from shorter_arm import three_joints

from server.composition.serve import serve
from server.machines.machine_resource import SIMULATE
from server.platform.database.engine import utc_now
from server.platform.processes import children
from server.platform.settings import Settings
from server.schedules.schedule_resource import CLOCK

#: Machine seconds per second.
SPEED = 4.0


def ready(url: str) -> None:
    print(json.dumps({"url": url}), flush=True)


if __name__ == "__main__":
    children.NICENESS = 0
    place, started = Path(sys.argv[1]), utc_now()
    hour = started.replace(minute=5, second=0, microsecond=0)

    def clock() -> datetime:
        return hour + (utc_now() - started) + timedelta(hours=float((place / "hours").read_text()))

    settings = Settings(
        data_dir=place / "data", port=0, simulate=True, simulation_speed=SPEED, access="required", local_jobs=True
    )
    serve(settings, ready, {CLOCK: clock, SIMULATE: three_joints})
