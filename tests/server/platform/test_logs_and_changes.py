"""Logs are JSON without secrets; changes wake waiters from other threads."""

from __future__ import annotations

import asyncio
import io
import json
import logging
import threading

import pytest
import structlog

from server.platform import logs
from server.platform.changes import Changes


def test_every_record_is_one_json_line_without_secrets() -> None:
    stream = io.StringIO()
    logs.configure(stream=stream)
    try:
        structlog.stdlib.get_logger("server.test").info("signed_in", token="abc", user="x", Authorization="abc")
        logging.getLogger("dbos").warning("a library\nspeaks")
        try:
            raise ValueError("cause")
        except ValueError as error:
            structlog.stdlib.get_logger("server.test").error("broke", exc_info=error)
    finally:
        logs.configure(stream=io.StringIO())
    lines = [json.loads(line) for line in stream.getvalue().splitlines()]
    assert [line["event"] for line in lines] == ["signed_in", "a library\nspeaks", "broke"]
    assert lines[0]["token"] == lines[0]["Authorization"] == logs.HIDDEN
    assert lines[0]["user"] == "x"
    assert all(line["timestamp"].endswith("Z") and line["level"] for line in lines)
    assert "ValueError: cause" in lines[2]["exception"]
    assert "abc" not in stream.getvalue()


def test_what_comes_after_the_stream_was_closed_is_dropped(capsys: pytest.CaptureFixture[str]) -> None:
    stream = io.StringIO()
    logs.configure(stream=stream)
    stream.close()
    structlog.stdlib.get_logger("server.test").info("late")
    assert capsys.readouterr().err == ""


def test_a_waiter_is_woken_from_another_thread() -> None:
    changes = Changes()

    async def wait() -> bool:
        waiting = asyncio.create_task(changes.wait(changes.number, 30))
        await asyncio.sleep(0)  # let it register
        threading.Thread(target=changes.notify).start()
        return await waiting

    assert asyncio.run(wait())


def test_a_change_before_waiting_is_not_lost() -> None:
    changes = Changes()
    seen = changes.number
    changes.notify()
    assert asyncio.run(changes.wait(seen, 30))


def test_waiting_for_a_change_times_out_and_ends_when_closed() -> None:
    changes = Changes()
    assert not asyncio.run(changes.wait(changes.number, 0.01))
    changes.close()
    assert changes.closed
    assert asyncio.run(changes.wait(changes.number, 30))
