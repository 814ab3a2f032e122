"""Which numbers of a report are poorly determined: a standard deviation above 30 % of the value.

Published tables have carried deviations of a hundred thousand per cent without a word; here each such parameter is
marked where it is (``relative_std_percent``, ``flagged``) and listed under ``flagged``. It is no warning: every
report has some, because no motion determines all parameters, and what they cost is in the band of the prediction.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

#: A parameter whose standard deviation is above this share of its value is poorly determined.
FLAG_PERCENT = 30.0


def mark(content: dict[str, Any]) -> None:
    """Mark all parameters of a report's content in place; add ``flagged``.

    ``flagged`` has an entry per parameter: ``name``, ``kind`` (``drive``, ``base``, ``effect``) and
    ``relative_std_percent`` (None where the value is zero).
    """
    flagged = []
    for kind, name, entry in _values(content):
        value, std = entry.get("value"), entry.get("std")
        if value is None or std is None:
            continue
        relative = abs(100.0 * std / value) if value else None
        bad = std > 0 and (relative is None or relative > FLAG_PERCENT)
        entry["relative_std_percent"], entry["flagged"] = relative, bad
        if bad:
            flagged.append({"name": name, "kind": kind, "relative_std_percent": relative})
    content["flagged"] = flagged


def _values(content: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for joint, cylinder in content["cylinders"].items():
        for name, entry in cylinder["parameters"].items():
            yield "drive", f"{joint}.{name}", entry
    for entry in content["rigid_body"]["parameters"]:
        yield "base", entry.get("name") or entry["expression"], entry
    for effect in content["loop"]["effects"]:
        for name, entry in effect.get("parameters", {}).items():
            yield "effect", f"{effect.get('joint') or 'machine'}.{effect['id']}.{name}", entry
