"""What the routes of the audit log give."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from server.audit.audit_log import Entry, Verification
from server.platform.database.engine import Page


class EntryResource(BaseModel):
    """An entry of the audit log; ``hash`` covers it and the hash of the entry before."""

    number: int
    time: str
    principal: str
    action: str
    subject: str
    detail: dict[str, Any]
    hash: str

    @classmethod
    def of(cls, value: Entry) -> EntryResource:
        """From the log."""
        return cls(**value.__dict__)


class EntryList(BaseModel):
    """A page of the audit log, newest first."""

    items: list[EntryResource]
    next: int | None

    @classmethod
    def of(cls, page: Page[Entry]) -> EntryList:
        """From the log."""
        return cls(items=[EntryResource.of(value) for value in page.items], next=page.next)


class VerificationResource(BaseModel):
    """Whether the log is as it was written.

    ``entries`` and ``last_hash``, noted elsewhere, also show later whether the newest entries were cut off.
    """

    intact: bool
    first_broken: int | None
    entries: int
    last_hash: str | None

    @classmethod
    def of(cls, value: Verification) -> VerificationResource:
        """From the verification."""
        return cls(**value.__dict__)
