"""Structured logs: one JSON object per line on standard error, ours and those of the libraries alike."""

from __future__ import annotations

import logging
import sys
from typing import Any, TextIO

import structlog

#: Keys that are never written, whatever a caller passes along.
SECRET_KEYS = frozenset({"authorization", "cookie", "set-cookie", "password", "token", "secret", "api_key"})
HIDDEN = "(hidden)"


def _hide_secrets(_logger: Any, _method: str, event: dict[str, Any]) -> dict[str, Any]:
    """Replace the values of :data:`SECRET_KEYS` in an event."""
    return {key: HIDDEN if key.lower() in SECRET_KEYS else value for key, value in event.items()}


class _Lines(logging.StreamHandler[TextIO]):
    """Writes lines; those that come after the stream was closed are dropped.

    While everything shuts down, a thread may still have something to say.
    """

    def handleError(self, record: logging.LogRecord) -> None:
        """Report what went wrong with a record, unless nothing can be written any more."""
        if not self.stream.closed:
            super().handleError(record)


def _shared() -> list[Any]:
    """List what every event passes, ours and those of the libraries."""
    return [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        _hide_secrets,
    ]


def json_lines() -> logging.Formatter:
    """Write a record, ours or a library's, as one JSON object without secrets."""
    formatter: logging.Formatter = structlog.stdlib.ProcessorFormatter(
        foreign_pre_chain=_shared(),
        processors=[
            structlog.stdlib.ProcessorFormatter.remove_processors_meta,
            structlog.processors.format_exc_info,
            structlog.processors.JSONRenderer(),
        ],
    )
    return formatter


def configure(stream: TextIO | None = None) -> None:
    """Send log records to ``stream`` (standard error) as JSON lines: our own from INFO on, warnings of libraries."""
    handler = _Lines(sys.stderr if stream is None else stream)
    handler.setFormatter(json_lines())
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(logging.WARNING)
    logging.getLogger("server").setLevel(logging.INFO)
    logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
    for name in ("uvicorn", "uvicorn.error", "uvicorn.access", "dbos"):
        library = logging.getLogger(name)
        library.handlers = []
        library.propagate = True
    structlog.configure(
        processors=[*_shared(), structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )
