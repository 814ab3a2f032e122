"""Looks that are taken again and again."""

from __future__ import annotations

import threading

from structlog.testing import capture_logs

from server.platform.processes.rounds import Rounds


def test_a_look_that_fails_is_said_once_a_minute_and_the_next_is_taken() -> None:
    looks, enough = [], threading.Event()

    def look() -> None:
        looks.append(1)
        if len(looks) == 5:
            enough.set()
        raise OSError("away")

    with capture_logs() as said:
        rounds = Rounds("tests", 0.001, look, at_once=True)
        rounds.start()
        assert enough.wait(60)
        rounds.stop()
    count = len(looks)
    assert [(line["event"], line["of"]) for line in said] == [("look_failed", "tests")]
    assert not threading.Event().wait(0.01) and len(looks) == count, "it goes on after it was stopped"


def test_the_first_look_is_at_once_or_after_a_while_and_stopping_needs_no_start() -> None:
    looked = threading.Event()
    rounds = Rounds("tests", 1e6, looked.set, at_once=True)
    rounds.start()
    assert looked.wait(60)
    rounds.stop()
    late = Rounds("tests", 1e6, lambda: (_ for _ in ()).throw(AssertionError))
    late.start()
    late.stop()
    Rounds("tests", 1.0, looked.set).stop()
