"""The committed OpenAPI file is what the service says of itself."""

from __future__ import annotations

import json
from typing import Any

import pytest

from server.commands.openapi_file import PLACE, describe, text_of


@pytest.fixture(scope="module")
def description() -> dict[str, Any]:
    return describe()


def test_the_interface_has_not_changed_unannounced(description: dict[str, Any]) -> None:
    committed, now = json.loads(PLACE.read_text(encoding="utf-8")), description
    changed = sorted(
        path for path in committed["paths"] | now["paths"] if committed["paths"].get(path) != now["paths"].get(path)
    )
    assert not changed, (
        f"{', '.join(changed)} changed; run 'python -m server.commands.openapi_file' and review the difference"
    )
    assert PLACE.read_text(encoding="utf-8") == text_of(now), (
        "run 'python -m server.commands.openapi_file' and review the difference"
    )


def test_every_operation_says_what_it_does_and_how_it_fails(description: dict[str, Any]) -> None:
    for path, operations in description["paths"].items():
        for method, operation in operations.items():
            assert operation.get("description"), f"{method} {path} has no description"
            for status, response in operation["responses"].items():
                if status >= "400":
                    assert set(response["content"]) == {"application/problem+json"}, f"{method} {path} {status}"
