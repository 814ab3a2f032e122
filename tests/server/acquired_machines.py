"""Machine files by name, and machines that are acquired, for tests of what is beside them."""

from __future__ import annotations

from service_fakes import API, MACHINE, Running, wait_for_change

from server.machines.acquisition import Acquisition

MACHINES = f"{API}/machines"


def named(name: str) -> str:
    """The lever's machine file under another name."""
    return MACHINE.replace("name: lever", f"name: {name}")


def acquire(running: Running, name: str) -> None:
    """Enable acquisition and wait until frames come."""
    running.client.post(MACHINES, content=named(name))
    running.client.put(f"{MACHINES}/{name}/acquisition", json={"enabled": True})
    number = running.service.changes.number
    while not running.service[Acquisition].running(name):
        assert wait_for_change(running.service, number, 10)
        number = running.service.changes.number
