"""Made-up requests over the whole interface, by nobody, by each role, by one who is bound to a machine, and one after
another as links lead.

No undocumented status, no 5xx but 503, every answer as described.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from access_fakes import Guarded, guarded_service
from hypothesis import HealthCheck, Phase, given, seed, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from service_fakes import API

from server.access.access_desk import Access
from server.alarms.alarm_desk import Alarms
from server.platform.authorization.principals import ROLES, SERVICE

CHECKS = [not_a_server_error, status_code_conformance, content_type_conformance, response_schema_conformance]
#: A stream that never ends is no answer to wait for; that it ends with its token is tried elsewhere.
ENDLESS = (f"{API}/events",)
HOST = {"Host": "127.0.0.1:8350"}
PHASES = [Phase.explicit, Phase.generate]
#: Made-up requests per operation and principal, and sequences of so many steps: a minute in all.
EXAMPLES, SEQUENCES, STEPS = 3, 6, 15

# The library under the test uses that module.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:Do not use the `random` module")]


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory, csv: bytes) -> Iterator[Guarded]:
    """A service with something of most kinds in it, so that made-up requests may meet it."""
    with guarded_service(tmp_path_factory.mktemp("data"), maximum_upload_bytes=400_000) as guarded:
        query = {"machine": "lever", "role": "train", "name": "made.csv"}
        headers = guarded.bearer("operator")
        guarded.client.post(f"{API}/recordings/upload", params=query, content=csv, headers=headers)
        guarded.running.service[Alarms].report("lever", "residual_drift", "joint1 drifts", "warning", True)
        yield guarded


def schema_of(guarded: Guarded) -> Any:
    app: Any = guarded.client.app
    return schemathesis.openapi.from_asgi(f"{API}/openapi.json", app, headers=HOST).exclude(path=list(ENDLESS))


@pytest.fixture(scope="module")
def requests(guarded: Guarded) -> dict[str, list[Any]]:
    """Requests of each operation, good and bad ones: made once for all, since that takes longer than asking."""
    return {own.label: made_up(own) for own in (found.ok() for found in schema_of(guarded).get_all_operations())}


def made_up(operation: Any) -> list[Any]:
    cases: list[Any] = []

    @seed(1)
    @settings(
        max_examples=EXAMPLES, deadline=None, database=None, phases=PHASES, suppress_health_check=list(HealthCheck)
    )
    @given(case=operation.as_strategy() | operation.as_strategy(generation_mode=GenerationMode.NEGATIVE))
    def make(case: Any) -> None:
        cases.append(case)

    make()
    return cases


def headers_of(guarded: Guarded, who: str) -> dict[str, str]:
    """Of a principal of its own: one that ends its session must not end that of the next operation."""
    if who == "nobody":
        return HOST
    role, _, machine = who.partition(" of ")
    machines = (machine,) if machine else None
    _, token = guarded.running.service[Access].make_key(who, role, machines, SERVICE)  # type: ignore[arg-type]
    return HOST | {"Authorization": f"Bearer {token}"}


@pytest.mark.parametrize("who", ["nobody", *ROLES, "engineer of lever"])
def test_generated_requests_are_answered_as_described(
    guarded: Guarded, requests: dict[str, list[Any]], who: str
) -> None:
    assert len(requests) > 60 and all(requests.values())
    found = []
    for label, cases in requests.items():
        headers = headers_of(guarded, who)
        for case in cases:
            try:
                case.call_and_validate(checks=CHECKS, headers=headers, timeout=60)
            except (AssertionError, BaseExceptionGroup) as error:
                found.append(f"{label}: {error.exceptions[0] if isinstance(error, BaseExceptionGroup) else error}")
    assert not found, "\n\n".join(found)


def test_generated_sequences_of_requests_are_answered_as_described(guarded: Guarded) -> None:
    """What one request made is read, changed and deleted by the next ones."""
    headers = headers_of(guarded, "admin")
    machine: Any = schema_of(guarded).exclude(path=f"{API}/access/me", method="DELETE").as_state_machine()

    class Walk(machine):  # type: ignore[misc]
        def get_call_kwargs(self, case: Any) -> dict[str, Any]:
            return {"headers": headers, "timeout": 60}

        def validate_response(self, response: Any, case: Any, **_: Any) -> None:
            # A machine file is text with its comments, as the interface says; the library reads YAML into objects.
            read_by_itself = str(case.path).endswith("/file")
            checks = [check for check in CHECKS if not read_by_itself or check is not response_schema_conformance]
            case.validate_response(response, checks=checks, headers=headers)

    bounded = settings(
        max_examples=SEQUENCES,
        stateful_step_count=STEPS,
        deadline=None,
        database=None,
        derandomize=True,
        phases=PHASES,
        suppress_health_check=list(HealthCheck),
    )
    Walk.run(settings=bounded)
