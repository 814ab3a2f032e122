"""Services with other settings: limits of rate, names, none at all; each test has a service of its own."""

from __future__ import annotations

from pathlib import Path

import pytest
from access_fakes import guarded_service
from service_fakes import API, Fakes, running_service

pytestmark = pytest.mark.slow

ACCESS = f"{API}/access"


def test_too_many_requests_are_told_when_to_come_back(tmp_path: Path) -> None:
    with guarded_service(tmp_path, requests_per_second=0.25) as slow:
        headers = slow.bearer("viewer")
        answers = [slow.client.get(f"{API}/machines", headers=headers) for _ in range(2)]
        assert [answer.status_code for answer in answers] == [200, 429]
        assert 1 <= int(answers[1].headers["retry-after"]) <= 4
        assert answers[1].headers["content-type"] == "application/problem+json"
        attempts = [slow.client.post(f"{ACCESS}/pair", json={"code": "0000000000", "name": "x"}) for _ in range(6)]
        assert [answer.status_code for answer in attempts] == [403] * 5 + [429]


def test_names_and_addresses_of_the_service(tmp_path: Path) -> None:
    with guarded_service(tmp_path, public_hosts=("hilfit.example", "proxy.example:8443")) as service:
        headers = service.bearer("viewer")
        for host, status in {
            "hilfit.example": 200,
            "HILFIT.example:8350": 200,
            "proxy.example:8443": 200,
            "proxy.example": 403,
            "192.168.7.4:8350": 200,
            "[fe80::1]:8350": 200,
            "rebound.example": 403,
        }.items():
            answer = service.client.get(f"{API}/machines", headers={**headers, "Host": host})
            assert answer.status_code == status, host


def test_without_set_up_whoever_is_here_is_local(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes()) as running:
        me = running.client.get(f"{ACCESS}/me").json()
        assert me == {
            "id": "local",
            "name": "local",
            "role": "admin",
            "machines": None,
            "kind": "local",
            "approves_own": True,
        }
        assert running.client.get(f"{API}/machines", headers={"Host": "192.168.7.4:8350"}).status_code == 403


def test_everything_has_a_content_security_policy(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes()) as running:
        for path in (f"{API}/machines", "/healthz", "/nowhere", "/"):
            assert "default-src 'none'" in running.client.get(path).headers["content-security-policy"]
