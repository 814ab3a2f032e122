"""What an operator reads of an overload. Free of numerical imports: the process that serves HTTP says it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def as_text(hit: Mapping[str, Any]) -> str:
    """What an operator reads."""
    return (
        f"{hit['joint']}: measured and predicted effort differ by {hit['residual']:+.4g} {hit['unit']}, "
        f"{abs(hit['score']):.1f} times the band (limit {hit['threshold']:.1f}): a collision or an overload; look at "
        "the arm"
    )
