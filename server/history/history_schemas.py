"""What ``GET /machines/{name}/history`` gives."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

from server.platform.http.bodies import Message


class FoundEffect(BaseModel):
    """An effect that an identification added to the model; ``joint`` is null for one of the whole machine."""

    id: str
    joint: str | None
    title: str


class HistoryEvent(BaseModel):
    """Something that happened to a machine.

    ``kind``: a new version of its ``file``; an ``identification`` that ended with a result; a step of a
    ``calibration``; a ``drift`` that the monitor or a recalibration noticed; another ``alarm``. ``what``: ``uploaded``;
    the verdict; the step (``proposed``, ``approved``, ``rejected``, ``activated``, ``retired``); the kind of the alarm.
    ``until``: when an alarm went; null while it is active, and for everything that takes no time. ``subject``: id of
    what it happened to. ``effects``: what the identification found. ``error``: error over all joints with them, in
    noise floors.
    """

    time: str
    until: str | None = None
    kind: Literal["file", "identification", "calibration", "drift", "alarm"]
    what: str
    text: str
    text_message: Message | None = None
    subject: str
    by: str | None = None
    severity: Literal["info", "warning", "critical"] | None = None
    effects: list[FoundEffect] = []
    error: float | None = None


class History(BaseModel):
    """The time line of a machine, newest first.

    ``since``: where it begins; what held then, an alarm or a calibration in use, is in it although it began before.
    ``complete``: false where a kind of event has more in that time than are given; the oldest are left out.
    """

    machine: str
    since: str
    complete: bool
    items: list[HistoryEvent]
