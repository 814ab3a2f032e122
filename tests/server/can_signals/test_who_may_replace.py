"""Who may look at the DBC files of a machine, and who may replace them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from access_fakes import guarded_service
from service_fakes import API, MACHINE

pytestmark = pytest.mark.slow

CAN = f"{API}/can-signals"
ROLES: dict[Any, tuple[int, int]] = {"viewer": (200, 403), "operator": (200, 403), "engineer": (200, 404)}


def test_roles_that_may_list_and_replace_signal_files(tmp_path: Path) -> None:
    with guarded_service(tmp_path) as guarded:
        for role, expected in ROLES.items():
            headers, query = guarded.bearer(role, None), {"machine": "lever", "name": "lever.dbc"}
            looked = guarded.client.get(CAN, params={"machine": "lever"}, headers=headers)
            sent = guarded.client.post(f"{CAN}/upload", params=query, content="", headers=headers)
            assert (looked.status_code, sent.status_code) == expected, role
        other = MACHINE.replace("name: lever", "name: another")
        guarded.client.post(f"{API}/machines", content=other, headers=guarded.bearer("engineer", None))
        foreign = guarded.bearer("engineer", ("another",))
        assert guarded.client.get(CAN, params={"machine": "lever"}, headers=foreign).status_code == 404
