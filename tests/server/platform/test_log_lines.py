"""The newest lines of the log in memory: the same as on standard error, without secrets, and never too many."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator

import pytest
import structlog

from server.log_lines.log_resource import LONGEST, LogMemory
from server.platform import logs

LOGGER = "server.tried"


@pytest.fixture
def stream() -> Iterator[io.StringIO]:
    stream = io.StringIO()
    logs.configure(stream=stream)
    yield stream
    logs.configure(stream=io.StringIO())


@pytest.fixture
def memory(stream: io.StringIO) -> Iterator[LogMemory]:
    memory = LogMemory(most=5)
    memory.start()
    yield memory
    memory.stop()


def test_the_log_memory_holds_the_lines_of_standard_error(memory: LogMemory, stream: io.StringIO) -> None:
    structlog.stdlib.get_logger(LOGGER).info("signed_in", token="abc", user="x")
    logging.getLogger("dbos").warning("a library\nspeaks")
    written = [json.loads(line) for line in stream.getvalue().splitlines()]
    for line, told in zip(memory.after(0, 10), written, strict=True):
        same = {"event": line.event, "level": line.level, "logger": line.logger} | line.detail
        assert same == {name: value for name, value in told.items() if name != "timestamp"}
    assert memory.after(0, 10)[0].detail == {"token": logs.HIDDEN, "user": "x"}


def test_the_oldest_give_way_and_numbers_go_on(memory: LogMemory) -> None:
    logger = structlog.stdlib.get_logger(LOGGER)
    for number in range(8):
        logger.info("counted", number=number)
    assert [line.number for line in memory.after(0, 10)] == [4, 5, 6, 7, 8]
    assert [line.detail["number"] for line in memory.after(6, 10)] == [6, 7]
    assert [line.number for line in memory.after(0, 2)] == [7, 8], "the newest, oldest first"
    assert memory.count == 8


def test_lines_are_narrowed_by_level_and_by_a_part_of_them(memory: LogMemory) -> None:
    logger = structlog.stdlib.get_logger(LOGGER)
    logger.info("machine_uploaded", machine="Crane")
    logger.error("monitor_failed", machine="crane")
    logger.warning("other", machine="lever")
    assert [line.event for line in memory.after(0, 10, logging.WARNING)] == ["monitor_failed", "other"]
    assert [line.event for line in memory.after(0, 10, containing="CRANE")] == ["machine_uploaded", "monitor_failed"]


def test_a_line_is_cut_where_it_is_endless(memory: LogMemory) -> None:
    structlog.stdlib.get_logger(LOGGER).error("broke", exception="x" * (2 * LONGEST))
    assert len(memory.after(0, 1)[0].detail["exception"]) < LONGEST + 10


def test_a_stopped_log_memory_stores_nothing(memory: LogMemory) -> None:
    memory.stop()
    structlog.stdlib.get_logger(LOGGER).info("late")
    assert memory.count == 0
