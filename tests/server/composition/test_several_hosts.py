"""The commands of docs/operation.md that make three hosts of one, in network namespaces, and a restore on a fourth."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from service_fakes import MACHINE, motion

from benchmarks.fleet.namespaces import HERE, NETWORK, Host, hosts
from benchmarks.service.hosts import FITTED
from benchmarks.service.postgresql import OWNER, PASSWORD, AbsentError, postgresql_server
from daq import parse_machine, write_recording

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]
PAGE = Path(__file__).parents[3] / "docs" / "operation.md"
#: ``hilfit``, whose children have the priority of everything here: beside other tests the lowest is next to nothing.
PROGRAM = """#!/bin/sh
exec {python} -P -c '
from server.commands.command_line import main
from server.platform.processes import children
children.NICENESS = children.SESSION_NICENESS = 0
main()
' "$@"
"""
#: Asks the service of its host for an identification, waits for it, and says who is there.
ORDER = """
import sys, httpx2
from pathlib import Path
from benchmarks.service.hosts import API, order_of, ordered, wait_for_jobs, wait_until
with httpx2.Client(base_url="http://127.0.0.1:8350" + API, timeout=600) as client:
    wait_until(lambda: client.get("/status").status_code == 200, 90, "the server")
    made = ordered(client, order_of(client, Path(sys.argv[1])) | {"options": {"loop": False}})
    wait_for_jobs(client, [made["job"]], 600)
    report = client.get(f"/identifications/{made['id']}/report.json").raise_for_status().content
    Path(sys.argv[2]).write_bytes(report)
    print(*sorted(row["id"] for row in client.get("/workers").json()["items"]))
"""
#: Says what a service that was restored knows of it.
LOOK = """
import sys, httpx2
from pathlib import Path
from benchmarks.service.hosts import API, wait_until
with httpx2.Client(base_url="http://127.0.0.1:8350" + API, timeout=600) as client:
    wait_until(lambda: client.get("/status").status_code == 200, 90, "the server")
    (row,) = client.get("/identifications").json()["items"]
    assert client.get(f"/identifications/{row['id']}/report.json").content == Path(sys.argv[1]).read_bytes()
"""


def steps() -> list[tuple[str, str]]:
    """Host and commands of each step of the page's section."""
    section = PAGE.read_text(encoding="utf-8").partition("## Several hosts")[2].partition("\n## ")[0]
    (block,) = re.findall(r"```sh\n(.*?)```", section, re.DOTALL)
    return re.findall(r"(?m)^# ([^\n]*)\n((?:(?!# ).*\n)+)", block)


@contextmanager
def running(command: list[str], environment: Mapping[str, str], log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("ab") as file:
        process = subprocess.Popen(command, env=environment, stdout=file, stderr=file, start_new_session=True)
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.wait(90)


def test_one_box_becomes_three_hosts_and_the_backup_a_fourth(tmp_path: Path) -> None:
    for folder in ("etc", "machines", "fits", "another", "mnt", "bin"):
        (tmp_path / folder).mkdir()
    (tmp_path / "etc" / "database_password").write_text("what only@they/know")
    shim = tmp_path / "bin" / "hilfit"
    shim.write_text(PROGRAM.format(python=sys.executable))
    shim.chmod(0o755)
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "machine.yaml").write_text(MACHINE)
    for role, stem in FITTED:
        write_recording(tmp_path / "case" / f"{stem}.parquet", parse_machine(MACHINE), role, *motion(20.0, len(role)))
    (_, store), (_, exports), (_, serve), (_, work), (_, backup), (_, restore) = steps()
    with ExitStack() as stack:
        try:
            machines, fits, another = stack.enter_context(hosts(3, tmp_path / "machines"))
            kept, later = (stack.enter_context(postgresql_server(network=(HERE, NETWORK))) for _ in range(2))
        except AbsentError as absent:
            pytest.skip(str(absent))

        def commands(text: str, folder: str, port: int) -> list[str]:
            for said, is_here in {
                "/etc/hilfit": str(tmp_path / "etc"),
                "/var/lib": str(tmp_path / folder),
                "/mnt/backups": str(tmp_path / "mnt"),
                "store.example": f"{HERE}:{port}",
                "s3://site/hilfit": f"file://{tmp_path}/bucket-{port}",
            }.items():
                text = text.replace(said, is_here)
            return ["sh", "-eu", "-c", text]

        def on(host: Host, text: str, folder: str, port: int) -> list[str]:
            words = commands(exports + text.replace("hilfit serve", "exec hilfit serve"), folder, port)
            return host.seeing_all(words) if host is machines else host.command(words)

        environment = dict(os.environ) | {"PATH": f"{tmp_path}/bin:{kept.programs}:{os.environ['PATH']}"}
        for server in (kept, later):  # the second one for the host that comes later
            administrator = {"PGHOST": HERE, "PGPORT": str(server.port), "PGUSER": OWNER, "PGPASSWORD": PASSWORD}
            run(commands(store, "", server.port), environment | administrator)
        with (
            running(on(machines, serve, "machines", kept.port), environment, tmp_path / "server.log"),
            running(on(fits, work, "fits", kept.port), environment, tmp_path / "worker.log"),
        ):
            report = tmp_path / "report.json"
            order = [sys.executable, "-P", "-c", ORDER, str(tmp_path / "case"), str(report)]
            assert run(machines.seeing_all(order), environment).split() == ["server", "worker-fits-1"]
            assert json.loads(report.read_bytes())["schema"] == "hilfit/report/1"
            run(on(machines, backup, "machines", kept.port), environment)
        run(on(another, restore, "another", later.port), environment)
        with running(on(another, serve, "another", later.port), environment, tmp_path / "another.log"):
            run(another.command([sys.executable, "-P", "-c", LOOK, str(report)]), environment)


def run(command: list[str], environment: Mapping[str, str]) -> str:
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, f"{done.stdout[-500:]} {done.stderr[-1500:]}"
    return done.stdout
