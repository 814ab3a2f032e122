"""What is to be said beyond this service, written in the transaction in which it became true.

So nothing that is in the store goes unsaid, whoever is killed when, and whichever host wrote it;
:mod:`server.outward` takes it from here.
"""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any, Literal

import sqlalchemy as sa

from server.platform.database.schema import outbox


def put_out(connection: sa.Connection, kind: Literal["alarm", "result"], now: str, content: Mapping[str, Any]) -> None:
    """Add something to be sent, in the transaction of ``connection``."""
    values = {"id": f"msg-{secrets.token_hex(12)}", "kind": kind, "time": now, "content": dict(content)}
    connection.execute(outbox.insert().values(**values))
