"""Made-up requests over the whole interface: no undocumented status, no 5xx, every answer as described."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from service_fakes import API, MACHINE, Fakes, Running, running_service

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
#: A stream that never ends is no answer to wait for.
ENDLESS = (f"{API}/events",)
HEADERS = {"Host": "127.0.0.1:8350"}
PHASES = [Phase.explicit, Phase.generate]


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory, csv: bytes) -> Iterator[Running]:
    """A service with something of most kinds in it, so that made-up requests may meet it."""
    with running_service(tmp_path_factory.mktemp("data"), Fakes(), maximum_upload_bytes=400_000) as running:
        running.client.post(f"{API}/machines", content=MACHINE)
        running.upload(csv, "train")
        running.service.alarms.report("lever", "residual_drift", "joint1 drifts", "warning", True)
        yield running


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Do not use the `random` module")  # the library under the test does
def test_no_made_up_request_is_answered_with_a_surprise(fuzzed: Running) -> None:
    app = fuzzed.client.app
    schema = schemathesis.openapi.from_asgi(f"{API}/openapi.json", app, headers=HEADERS)  # type: ignore[arg-type]
    surprises = []
    operations = [found.ok() for found in schema.exclude(path=list(ENDLESS)).get_all_operations()]
    assert len(operations) > 25
    for operation in operations:

        @seed(1)
        @settings(max_examples=6, deadline=None, database=None, phases=PHASES, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy())
        def ask(case: Any) -> None:
            case.call_and_validate(checks=CHECKS, headers=HEADERS, timeout=60)

        try:
            ask()
        except BaseExceptionGroup as error:
            surprises.append(f"{operation.label}: {error.exceptions[0]}")
        except AssertionError as error:
            surprises.append(f"{operation.label}: {error}")
    assert not surprises, "\n\n".join(surprises)
