"""Sample values for every message, and what Python says of them: for the tests here, and for those of the page.

``python tests/server/platform/message_cases.py`` from the project's root writes them as JSON; it needs no library.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from functools import cache
from itertools import count
from pathlib import Path
from string import Formatter
from typing import Any

ROOT = Path(__file__).parents[3]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from daq.messages import Sentence, texts  # noqa: E402

PACKAGES = ("daq", "fitting", "server", "sim_backends")
NUMBERS = (0.5, 2.5, 1234.5678, -2.5e-7, 0.0, 1e21 / 3, 99999.95, 0.00012345, 7, -1.25, 1e-4, 123456789.0, 0.1 + 0.2)
FORMATS = ("", "g", ".1g", ".2g", ".3g", ".4g", ".6g", "+.3g", ".0f", ".1f", "+.2f", ".7f", ".0%", ".1%")
NAMES: tuple[Any, ...] = (
    "joint1",
    "supply_pressure",
    "a.b-1.5.csv",
    "1.5 m",
    3,
    2.0,
    1e-5,
    ["a", "1.5", 0.25],
    None,
    "",
)


def placeholders(text: str) -> dict[str, str]:
    """Name the placeholders of a text, with their formats."""
    return {name: spec or "" for _, name, spec, _ in Formatter().parse(text) if name is not None}


def sample(code: str, number: int) -> Sentence:
    """Make a message with values that differ from message to message."""
    package, _, key = code.partition(".")
    words = sorted(texts(package, "de")["words"])
    chosen: dict[str, Any] = {}
    for at, (name, spec) in zip(
        count(number), placeholders(texts(package, "en")["messages"][key]).items(), strict=False
    ):
        numeric = spec != "" and spec[-1] in "gf%,"
        listed = spec != "" and not numeric
        named: tuple[Any, ...] = (*NAMES, words[at % len(words)], named_message())
        values = (12345, 7, 1234567) if spec == "," else NUMBERS if numeric else named
        chosen[name] = [values[at % len(values)], "b"] if listed else values[at % len(values)]
    return Sentence(code, **chosen)


def named_message() -> Sentence:
    """Return a message to stand in others."""
    return Sentence("daq.named", name="arm.yaml:3", what=Sentence("daq.value_missing"))


@cache
def codes() -> tuple[str, ...]:
    """Name all messages of the product."""
    return tuple(f"{package}.{key}" for package in PACKAGES for key in texts(package, "en")["messages"])


def cases() -> Iterator[dict[str, Any]]:
    """Give each message with its German text."""
    for number, code in enumerate(codes()):
        message = sample(code, number)
        yield message.to_json() | {"text": message.worded("de")}


if __name__ == "__main__":
    numbers = [[value, spec, (format(value, spec) if spec else str(value).removesuffix(".0"))]
               for value in NUMBERS for spec in FORMATS]  # fmt: skip
    json.dump({"messages": list(cases()), "numbers": numbers}, sys.stdout)
