"""``/metrics`` as Prometheus reads it."""

from __future__ import annotations

import pytest
from prometheus_client.parser import text_string_to_metric_families
from service_fakes import API, MACHINE, Running, wait_for_change

from server.alarms.alarm_desk import Alarms
from server.machines.acquisition import Acquisition


def samples(running: Running) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    response = running.client.get("/metrics")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/plain; version=0.0.4")
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(response.text)
        for sample in family.samples
    }


@pytest.mark.slow
def test_what_the_service_does_can_be_read(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.fakes.acquisition.up.clear()
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
    assert running.fakes.acquisition.up.wait(30)
    while not running.service[Acquisition].running("lever"):
        wait_for_change(running.service, running.service.changes.number, 0.1)
    running.service[Alarms].report("lever", "residual_drift", "x", "warning", True)
    found = samples(running)
    assert found["hilfit_acquisition_state", (("machine", "lever"), ("state", "running"))] == 1
    assert found["hilfit_acquisition_state", (("machine", "lever"), ("state", "off"))] == 0
    assert (
        found["hilfit_alarms_active", (("kind", "residual_drift"), ("machine", "lever"), ("severity", "warning"))] == 1
    )
    assert found["hilfit_disk_free_bytes", ()] > 0
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False})


def test_requests_are_counted_by_route_and_an_id_makes_no_series(running: Running) -> None:
    for id in ("rec-1", "rec-2", "rec-3"):
        running.client.get(f"{API}/recordings/{id}")
        running.client.get(f"/nowhere/{id}")
    found = {
        labels: value
        for (name, labels), value in samples(running).items()
        if name == "hilfit_http_request_seconds_count"
    }
    paths = {dict(labels)["route"] for labels in found}
    assert not any("rec-" in path for path in paths)
    key = (("method", "GET"), ("route", "/recordings/{id}"), ("status", "404"))
    assert found[key] == 3
    assert found[("method", "none"), ("route", "none"), ("status", "404")] >= 3


def test_two_services_share_nothing(running: Running) -> None:
    from server.composition.app import Metrics

    running.client.get(f"{API}/recordings")
    assert b"hilfit_http_request_seconds_count" not in Metrics(running.service).text()


@pytest.mark.slow
def test_lateness_becomes_cumulative_buckets_in_seconds() -> None:
    from server.machines.machine_resource import _buckets

    assert _buckets({"0.1": 2, "0.5": 1, "inf": 4}) == [("0.0001", 2), ("0.0005", 3), ("+Inf", 7)]
