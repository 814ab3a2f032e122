"""What the routes of the audit log give."""

from __future__ import annotations

from typing import Any

from server.platform.http.bodies import Listed, Shown


class EntryResource(Shown):
    """An entry of the audit log; ``hash`` covers it and the hash of the entry before."""

    number: int
    time: str
    principal: str
    action: str
    subject: str
    detail: dict[str, Any]
    hash: str


class EntryList(Listed[EntryResource]):
    """A page of the audit log, newest first."""


class VerificationResource(Shown):
    """Whether the log is as it was written.

    ``entries`` and ``last_hash``, noted elsewhere, also show later whether the newest entries were cut off.
    """

    intact: bool
    first_broken: int | None
    entries: int
    last_hash: str | None
