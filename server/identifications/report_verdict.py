"""What the report of an identification says in one word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fitting.report import looked


def verdict_of(report: Mapping[str, Any]) -> str:
    """The report's verdict; ``not_looked_for`` where the loop was left out and "nothing is missing" says nothing."""
    loop = report["loop"]
    return str(loop["verdict"]) if looked(loop) else "not_looked_for"
