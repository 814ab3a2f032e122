"""What the report of an identification says in one word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.report import looked


def verdict_of(report: Mapping[str, Any]) -> str:
    """Return the report's verdict; ``not_looked_for`` if without the loop, where it would mean nothing."""
    loop = report["loop"]
    return str(loop["verdict"]) if looked(loop) else "not_looked_for"
