"""``hilfit demo`` as people use it: interrupted, killed, started twice, and with the words that README.md prints.

Recordings are half as long as the demo's own, for whose numbers there is ``hilfit bench demo``. Those of the demo that
is let to its end are identified through REST as well: a service says of them what the command line says, and acquires
another machine meanwhile.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest
from bench_machines import modbus
from modbus_test_server import FakeModbus, float_registers
from service_fakes import API, Fakes, Running, running_service, wait_for_change

from benchmarks.demonstration import printed_result, shown_by_the_demo
from server.commands.demo_command import PLAN
from server.identifications.identification_resource import STAGE_PROGRAM
from server.machines.machine_resource import LAUNCH

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

COMMAND = [sys.executable, "-m", "server.commands.command_line", "demo", "--seconds", "20"]


def demo(
    folder: Path, *, until: str = "", then: Callable[[subprocess.Popen[str]], None] | None = None
) -> tuple[int, str, str]:
    """Run the demo in ``folder``; when it says ``until``, do something. Status and what it printed."""
    said = ""
    with subprocess.Popen(
        COMMAND, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background job ignores it
    ) as running:  # fmt: skip
        assert running.stdout is not None and running.stderr is not None
        for line in running.stderr:
            said += line
            if then is not None and until in line:
                then(running)
                then = None
        printed = running.stdout.read()
    return running.returncode, printed, said


def words(result: str) -> list[str]:
    """All but numbers, lines of the table, and how many terms the law of the friction has."""
    return re.findall(r"[a-z]\w*", re.sub(r"\(f_1.*?\); with", "with", result, flags=re.DOTALL))


def left(folder: Path) -> set[str]:
    """Reports, and files of recordings."""
    made = folder / "hilfit-demo"
    return {path.name for pattern in ("*.json", "*.html", "recordings/*") for path in made.glob(pattern)}


@contextmanager
def acquired(site: Running) -> Iterator[None]:
    """A machine with two Modbus units is acquired all the while: cycles come, none is skipped, nearly all is fresh."""

    def counts() -> Any:
        while True:
            number = site.service.changes.number
            found = site.client.get(f"{API}/status").json()["acquisition"]["bench"].get("counts")
            if found is not None and found["cycles"] > 0:
                return found
            wait_for_change(site.service, number, 1.0)

    with closing(FakeModbus({1: float_registers({2: 50.0, 4: 0.0, 6: 0.3}), 2: {4: 215}})) as devices:
        # A busy computer delays a cycle then, and skips none.
        machine = modbus(devices.port, timeout_s=1.0) + "simulation: {lockstep: true}\n"
        assert site.client.post(f"{API}/machines", content=machine).status_code == 201
        enabled = site.client.put(f"{API}/machines/bench/acquisition", json={"enabled": True})
        assert enabled.status_code == 200, enabled.text
        before = counts()
        yield
        after = counts()
    assert after["cycles"] > before["cycles"] and after["skipped"] == 0
    for channel, of_channel in after["quality"].items():
        assert of_channel["fresh"] > 0.99 * sum(of_channel.values()), (channel, of_channel)


def identified_over_rest(place: Path, machine: Path, recordings: Mapping[Path, str]) -> tuple[dict[str, Any], str]:
    """The report of recordings, files with their roles, by a service with the stages that a site has; and its page."""
    fakes = Fakes()
    del fakes.parts[STAGE_PROGRAM], fakes.parts[LAUNCH]
    with running_service(place, fakes) as site, acquired(site):
        name = site.client.post(f"{API}/machines", content=machine.read_bytes()).json()["name"]
        chosen = []
        for path, role in recordings.items():
            query = {"machine": name, "role": role, "name": path.name}
            answer = site.client.post(f"{API}/recordings/upload", params=query, content=path.read_bytes())
            assert answer.status_code == 201, answer.text
            chosen.append({"id": answer.json()["id"]})
        ordered = site.client.post(f"{API}/identifications", json={"machine": name, "recordings": chosen})
        assert ordered.status_code == 202, ordered.text
        job = ordered.headers["location"]
        with site.client.stream("GET", f"{job}/events") as stream:
            told = [json.loads(line[6:]) for line in stream.iter_lines() if line.startswith("data: ")]
        assert told[-1]["state"] == "done", site.client.get(job).json()
        assert [*dict.fromkeys(event["stage"] for event in told[1:])] == site.client.get(job).json()["stages"]
        made = f"{API}/identifications/{ordered.json()['id']}"
        report = site.client.get(f"{made}/report.json").json()
        assert site.client.get(made).json()["verdict"] == report["loop"]["verdict"]
        page = site.client.get(f"{made}/report.html")
        assert page.status_code == 200
        return report, page.text


def same(report: dict[str, Any], other: dict[str, Any]) -> None:
    """Two reports of the same recordings say the same."""
    assert report["schema"] == other["schema"] == "hilfit/report/1"
    assert report["reduction"] == other["reduction"] == {"standard_parameters": 78, "base_parameters": 18}
    by_role = [sorted((entry["role"], entry["samples"]) for entry in one["data"]) for one in (report, other)]
    assert by_role[0] == by_role[1]
    loops = report["loop"], other["loop"]
    assert loops[0]["verdict"] == loops[1]["verdict"]
    effects, others = (one["effects"] for one in loops)
    assert [(one["id"], one["joint"]) for one in effects] == [(one["id"], one["joint"]) for one in others]
    for joint, errors in report["errors"].items():
        for when in ("before", "after"):
            assert errors[when]["validate"] == pytest.approx(other["errors"][joint][when]["validate"], rel=1e-6)


def test_it_is_interrupted_killed_started_twice_and_does_what_readme_says(tmp_path: Path) -> None:
    made = tmp_path / "hilfit-demo"
    made.mkdir()
    for name in ("report.html", "report.json", "model.json", "mine.html"):
        (made / name).write_text("of an earlier demo, or mine")
    second: list[subprocess.CompletedProcess[str]] = []

    def interrupt(running: subprocess.Popen[str]) -> None:
        """Try another one in the same folder, then press Ctrl-C, which goes to all processes of a terminal."""
        second.append(subprocess.run(COMMAND, cwd=tmp_path, capture_output=True, text=True, timeout=120))
        os.killpg(running.pid, signal.SIGINT)

    status, printed, said = demo(tmp_path, until="recording train-1", then=interrupt)
    (other,) = second
    assert (other.returncode, other.stdout) == (2, "")
    assert other.stderr.startswith("hilfit: hilfit-demo: another demo is running in this directory")
    assert len(other.stderr.splitlines()) == 1
    assert (status, printed) == (130, "")
    assert re.fullmatch(r"hilfit: interrupted \([a-z0-9 -]+\)", said.splitlines()[-1])
    assert {"mine.html", "unloaded.parquet"} <= left(tmp_path)
    assert not {"report.html", "report.json", "model.json"} & left(tmp_path)

    status, _, _ = demo(
        tmp_path, until="recording unloaded", then=lambda running: os.killpg(running.pid, signal.SIGKILL)
    )
    assert status == -signal.SIGKILL
    (made / "recordings" / "train-2.parquet.journal").write_bytes(b"a kill left it")

    status, printed, said = demo(tmp_path)
    assert status == 0, f"the journal of a demo that was killed is no obstacle: {said}"
    assert not [name for name in left(tmp_path) if name.endswith(".journal")]
    assert words(shown_by_the_demo(printed)) == words(printed_result()), "README.md's result is made by: make readme"

    recorded = {made / "recordings" / f"{name}.parquet": role for name, role, _ in PLAN}
    report, page = identified_over_rest(tmp_path / "data", made / "machine" / "machine.yaml", recorded)
    same(report, json.loads((made / "report.json").read_text("utf-8")))
    found, errors = report["loop"]["effects"][0], report["errors"]["joint2"]
    assert (found["id"], found["joint"]) == ("position_dependent_friction", "joint2")
    # It was well above the floor, and falls; by how much is for hilfit bench demo, with recordings of full length.
    assert errors["before"]["validate"] > 1.5 * errors["noise_floor"]
    assert errors["after"]["validate"] < 0.9 * errors["before"]["validate"]
    assert report["loop"]["verdict"] != "nothing_missing"
    assert "joint2" in page
