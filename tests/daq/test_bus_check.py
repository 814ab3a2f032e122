"""The bus check: what values at rest tell, against noise and drift that were made; devices of a simulated machine."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest
from bench_machines import can
from shorter_arm import shorter_arm
from typer.testing import CliRunner

from daq import parse_machine
from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.ring import RingReader
from daq.commissioning.can_questions import FoundNode
from daq.commissioning.identities import identity_findings, mapping_of, scale_finding
from daq.commissioning.rest import AtRest, at_rest
from server.bus_checks.bus_check_resource import check_running
from server.commands.command_line import build
from sim_backends import SimulatedMachine

RATE = 50.0
T = np.arange(3000) / RATE


def rest(values: np.ndarray, quality: np.ndarray | None = None, ages: np.ndarray | None = None) -> AtRest:
    flags = np.zeros(len(values), dtype=np.uint8) if quality is None else quality
    return at_rest(T[: len(values)], values, np.zeros(len(values)) if ages is None else ages, flags)


def test_noise_step_and_value() -> None:
    rng = np.random.default_rng(0)
    found = rest(np.round(50.0 + rng.normal(0, 0.3, 3000), 2))
    assert found.noise == pytest.approx(0.3, rel=0.05)
    assert found.mean == pytest.approx(50.0, abs=0.03)
    assert found.step == pytest.approx(0.01) and not found.moved
    assert abs(found.drift) < 4 * found.drift_std


def test_drift_is_found_with_its_deviation() -> None:
    rng = np.random.default_rng(1)
    found = rest(50.0 + 2.0 * T / 60 + rng.normal(0, 0.3, 3000))
    assert found.drift == pytest.approx(2.0, abs=4 * found.drift_std) and found.drift_std < 0.1


def test_a_machine_that_moves_is_not_at_rest_but_its_noise_is_still_told() -> None:
    rng = np.random.default_rng(2)
    found = rest(5.0 * np.sin(T) + rng.normal(0, 0.01, 3000))
    assert found.moved and math.isnan(found.drift)
    assert found.noise == pytest.approx(0.01, rel=0.1)


def test_what_did_not_come_is_counted_and_held_values_are_not_due() -> None:
    quality = np.zeros(1000, dtype=np.uint8)
    quality[::4], quality[1::4] = 2, 9  # missing, held
    found = rest(np.where(quality == 2, np.nan, 1.0), quality, np.where(quality == 9, 0.02, 0.004))
    assert found.share == pytest.approx(2 / 3) and found.others == {"missing": 250}
    assert found.values == 500 and found.age_ms == pytest.approx(4.0) and found.noise == 0.0


def test_a_slow_unit_is_judged_by_its_late_values() -> None:
    quality = np.full(1000, 3, dtype=np.uint8)
    assert rest(np.ones(1000), quality).values == 1000


MACHINE = parse_machine(can("x"))
PRESSURE = FoundNode(6, device_type=0x0002_0194, objects={"0x6131:1": 0x004E_0000, "0x6131:2": 0x0622_0000})


def test_what_commissioning_sets_is_not_judged_before() -> None:
    assert scale_finding(MACHINE, MACHINE.channels[2], PRESSURE) is None, "this node has settings"


def test_units_are_compared_where_nothing_is_written_to_them() -> None:
    plain = parse_machine(can("x").replace(', settings: {"0x61A1:1 uint16": 3}', ""))
    assert scale_finding(plain, plain.channels[1], PRESSURE) is None
    said = scale_finding(plain, plain.channels[2], PRESSURE)
    assert said is not None and "10 times" in said and "MPa" in said


def test_an_encoder_of_another_resolution_is_told() -> None:
    node = FoundNode(5, device_type=0x0001_0196, objects={"0x6001:0": 4096})
    said = scale_finding(MACHINE, MACHINE.channels[0], node)
    assert said is not None and f"({2 * math.pi / 4096:.6g})" in said


def test_another_device_is_named() -> None:
    found = FoundNode(5, device_type=0x0008_0194, vendor_id=0x2B, product_code=7)
    assert identity_findings(MACHINE, "can0", found) == [
        "bus 'can0' node 5: vendor_id is 0x0000002B, the machine file says 0x0000002A; which device is it?"
    ]


def test_a_mapping_is_shown_as_commissioning_makes_it() -> None:
    assert mapping_of(MACHINE, "can0", "node 6") == "TPDO1 0x186: 0x6130:1/32, 0x6130:2/32"


def identity_in_service(path: Path) -> dict[str, str]:
    """What node 11 has told the driver once the machine is acquired, as the check of a running machine shows it."""
    with AcquisitionProcess(path) as acquisition, RingReader(acquisition.ring_name, from_start=True) as ring:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            ring.wait(0.5)
            rows = ring.read().rows
            found = check_running(acquisition.machine, rows, acquisition.statistics()) if len(rows) else None
            encoder = [device for device in found.devices if device.device == "node 11"] if found else []
            if encoder and encoder[0].identity:
                return encoder[0].identity
    raise AssertionError("node 11 was never asked")


@pytest.mark.slow
def test_the_commands_on_a_simulated_machine(tmp_path: Path) -> None:
    """Independent nodes and units over sockets: scan, check and monitor of an arm with a joint on either bus."""
    machine, truth = shorter_arm(1, 4)
    with SimulatedMachine(machine, truth, seed=1, workdir=tmp_path) as running:
        file, page = str(running.machine_path), tmp_path / "check.html"

        scanned = CliRunner().invoke(build(), ["bus", "scan", file, "--seconds", "0.5", "--json", "--ask"])
        can_bus, modbus = json.loads(scanned.stdout)["buses"]
        sources = [channel.source for channel in machine.channels]
        wanted = {source.node for source in sources if source is not None and source.bus == "can"}
        assert {node["node"] for node in can_bus["nodes"]} == wanted and can_bus["masters"] == ""
        assert {unit["unit"] for unit in modbus["units"]} == {4, 10}

        checked = CliRunner().invoke(build(), ["bus", "check", file, "--seconds", "4", "-o", str(page), "--json"])
        content = json.loads(checked.stdout)
        assert {device["state"] for device in content["devices"]} == {"running"}
        for rest in (channel["rest"] for channel in content["channels"]):
            # On a busy computer a node is not there yet in the first cycles, which do not wait for it beyond a second.
            assert rest["values"] + sum(rest["others"].values()) == 200 and rest["values"] > 100
        assert all(device["latency_ms"] for device in content["devices"])
        encoder = next(device for device in content["devices"] if device["device"] == "node 11")
        assert encoder["identity"]["device"] == "HF-RE20 rotary encoder"
        by_name = {c["name"]: c["rest"]["noise"] for c in content["channels"]}
        assert by_name["supply_pressure"] == pytest.approx(0.015, rel=0.5), "as the machine file's noise_std says"
        assert "<h2>Channels</h2>" in page.read_text() and "joint4.angle" in page.read_text()

        unit = next(device for device in content["devices"] if device["device"] == "unit 4")
        assert unit["identity"] == {"device": "HF-MB4 transmitter", "firmware": "1.0", "vendor": "hilfit"}

        assert identity_in_service(running.machine_path)["device"] == "HF-RE20 rotary encoder"

        watched = CliRunner().invoke(build(), ["bus", "monitor", file, "--seconds", "1.5", "--rate", "2"])
        assert watched.exit_code == 0 and "joint4.angle" in watched.stdout and "fresh" in watched.stdout

        asked = CliRunner().invoke(build(), ["bus", "monitor", file, "--seconds", "1.5", "--rate", "2", "--json"])
        pictures = [json.loads(line) for line in asked.stdout.splitlines()]
        assert len(pictures) >= 2
        assert pictures[-1]["channels"]["joint4.angle"]["quality"] == "fresh"
