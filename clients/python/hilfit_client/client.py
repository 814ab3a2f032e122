"""The client: every operation of the service, and waiting for what takes long."""

from __future__ import annotations

import time

from hilfit_client.generated import Api, JobResource, RecordingResource
from hilfit_client.transport import Transport

FINAL = ("done", "failed", "cancelled")
LOOK_S = 0.2


class Client(Api):
    """A service, as one principal sees it; see :class:`hilfit_client.transport.Transport` for the parameters.

    ::

        client = Client("http://192.168.1.20:8350", token=KEY)
        recording = client.recordings.start(machine="folding-arm", role="train", seconds=60)
        client.wait_recording(recording["id"])
        Path("train.csv").write_bytes(client.recordings.data(recording["id"], format="csv"))
    """

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 60.0) -> None:
        super().__init__(Transport(url, token, timeout_s))

    def wait_job(self, job: str) -> JobResource:
        """Follow a job to its end; whether it is done or failed is in its ``state``."""
        while (found := self.jobs.get(job))["state"] not in FINAL:
            # The stream tells of every step; it ends with the job, or with the service.
            for event in self.jobs.events(job):
                if event["state"] in FINAL:
                    break
        return found

    def wait_recording(self, recording: str, timeout_s: float = 3600.0) -> RecordingResource:
        """Wait until a recording has ended; TimeoutError if it does not."""
        until = time.monotonic() + timeout_s
        while (found := self.recordings.get(recording))["state"] == "recording":
            if time.monotonic() > until:
                raise TimeoutError(f"recording {recording} has not ended within {timeout_s:g} s; stop it")
            time.sleep(LOOK_S)
        return found
