"""What ``/status`` gives."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel


class Status(BaseModel):
    """The service at a glance; a list need not be read again until its number in ``revisions`` moves."""

    version: str
    started: str
    revisions: dict[str, int]
    jobs: dict[str, int]
    acquisition: dict[str, dict[str, Any]]
