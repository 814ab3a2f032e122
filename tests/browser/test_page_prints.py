"""What is made to be printed, on paper: the bus check of a whole machine is one A4 page."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from lever_site import Site

pytestmark = pytest.mark.slow

CHANNEL = {
    "unit": "bar", "value": 101.25, "raw": 4711.0, "noise": 0.0153, "step": 0.01, "drift": 0.012, "drift_std": 0.034,
    "moved": False, "age_ms": 1.2, "jitter_ms": 0.4, "share": 1.0, "others": {},
}  # fmt: skip
#: As many devices and channels as an arm of six joints on two buses has, each with all that can be said of it.
CHECK = {
    "machine": "lever", "utc": "2026-03-01 08:00 UTC", "seconds": 20.0, "rate_hz": 50.0, "cycles": 5000, "skipped": 0,
    "worst_late_ms": 3.21,
    "devices": [
        {
            "bus": "can" if k < 12 else "modbus", "device": f"node {k + 1}", "state": "running", "detail": "",
            "identity": {"device": "HF-P40 pressure sensor", "serial number": "0x00000042", "firmware": "1.2"},
            "mapping": "TPDO1 0x19F: 0x6130:1/32, 0x6130:2/32", "latency_ms": 1.234, "jitter_ms": 0.5,
        }
        for k in range(16)
    ],
    "channels": [
        {"name": f"joint{k // 4 + 1}.p{k}", "bus": "can" if k < 24 else "modbus", "device": f"node {k}", **CHANNEL}
        for k in range(28)
    ],
    "delays": [
        {
            "bus": "modbus", "reference": "can", "delay_ms": 12.34, "std_ms": 1.2,
            "told_by": [
                {"joint": f"joint{k}", "kind": "effort", "delay_ms": 12.9, "std_ms": 1.5} for k in range(1, 7)
            ],
        }
    ],
    "findings": [f"joint{k}.pressure: noise is 0.2 bar, 4.0 times what noise_std and resolution say; look at shield "
                 "and earth, or correct noise_std" for k in range(1, 4)],
    "notes": ["bus 'can': is listen_only, so no device was asked who it is"],
    "messages": {
        "bus 'can': is listen_only, so no device was asked who it is": {
            "code": "server.bus_listen_only_no_device",
            "values": {"bus": "can"},
        }
    },
}  # fmt: skip


def pages_of(pdf: bytes) -> int:
    """Pages of a PDF, whose tree says how many there are (ISO 32000-1, 7.7.3.2)."""
    return max(int(count) for count in re.findall(rb"/Type\s*/Pages\b[^>]*?/Count\s+(\d+)", pdf))


@pytest.mark.parametrize("language", ["en", "de"])
def test_the_bus_check_of_an_arm_of_six_joints_is_one_page(page: Any, site: Site, language: str) -> None:
    answer = json.dumps(CHECK)
    page.route("**/bus-check?*", lambda route: route.fulfill(status=200, content_type="application/json", body=answer))
    page.add_init_script(f"localStorage.setItem('hilfit.language', '{language}')")
    page.goto(f"{site.url}/#/bus-check/lever")
    word = {"en": "Delays between buses", "de": "Verzug zwischen den Bussen"}[language]
    page.get_by_role("heading", name=word).wait_for()
    page.get_by_role("cell", name=re.compile("joint6")).last.wait_for()
    assert pages_of(page.pdf(prefer_css_page_size=True)) == 1
