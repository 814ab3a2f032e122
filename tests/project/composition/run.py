"""Runs docker-compose.yml: ``python tests/project/composition/run.py [SECONDS]``; at most ten minutes, unless told.

Builds, starts, pairs, records, identifies on a worker, kills the worker, takes the database away for half a minute,
backs up, upgrades a store of an older version and restores. Says why and ends with 0 where there can be no engine.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import ssl
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from engine import HERE, TOP, AbsentError, Engine, FailedError, base_image, engine

BOUND_S = 600
PORT = 18350
OLDER = (
    "UPDATE store_version SET version = 4; ALTER TABLE principals DROP COLUMN expires; "
    "ALTER TABLE pairing_codes DROP COLUMN days; DROP TABLE hosts"
)


class Site:
    """The composition while it is tried.

    Parameters
    ----------
    directory : gets the files that a person would have
    """

    def __init__(self, docker: Engine, directory: Path) -> None:
        self._docker, self._directory = docker, directory
        self._token = ""
        self._began = time.monotonic()
        (directory / "secrets").mkdir(mode=0o700)
        for name, content in (("database_password", os.urandom(24).hex()), ("metrics_key", "")):
            (directory / "secrets" / name).write_text(content)
            (directory / "secrets" / name).chmod(0o444)
        docker.environment |= {"HILFIT_PORT": str(PORT), "HILFIT_PUBLIC_HOST": f"localhost:{PORT}"}

    def say(self, text: str) -> None:
        """Tell how far it is."""
        print(f"{time.monotonic() - self._began:6.1f} s  {text}", flush=True)

    def compose(self, *arguments: str, timeout: float = 120) -> str:
        """Run ``docker compose``."""
        files = [f"--file={TOP / 'docker-compose.yml'}", f"--file={self._directory / 'here.yml'}"]
        place = f"--project-directory={self._directory}"
        return self._docker("compose", *files, place, "--project-name=hilfit-try", *arguments, timeout=timeout)

    def build(self) -> None:
        """Images, and the file that names them."""
        try:
            base = base_image(self._docker, "hilfit-try-base")
        except FailedError as failed:
            raise AbsentError(f"no base image can be made here: {failed}") from None
        self.say("a base image is there")
        named = {"server": {"build": {"context": str(TOP), "args": {"BASE": base}}}}
        for name in ("worker-1", "worker-2"):
            named[name] = named["server"]
        for name in ("database", "prometheus"):
            tag = f"hilfit-try-{name}"
            self._docker(
                "buildx", "build", "--quiet", f"--target={name}", f"--build-arg=BASE={base}", f"--tag={tag}", "--load",
                str(HERE), timeout=600,
            )  # fmt: skip
            named[name] = {"image": tag}  # type: ignore[dict-item]
        (self._directory / "here.yml").write_text(json.dumps({"services": named}))
        shutil.copytree(TOP / "deploy", self._directory / "deploy")
        self._docker(
            "buildx", "build", f"--build-arg=BASE={base}", "--tag=hilfit:local", "--load", str(TOP), timeout=1200
        )
        size = int(self._docker("image", "inspect", "--format={{.Size}}", "hilfit:local"))
        self.say(f"built; the image has {size / 1e6:.0f} MB, {size / 1e6 - self._base_mb(base):.0f} above its base")

    def _base_mb(self, base: str) -> float:
        return int(self._docker("image", "inspect", "--format={{.Size}}", base)) / 1e6

    def ask(self, method: str, path: str, body: Any = None) -> Any:
        """A request; the content of the answer. It is asked again while the service is away."""
        content = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": "application/json"} | (
            {"Authorization": f"Bearer {self._token}"} if self._token else {}
        )
        end = time.monotonic() + 90
        while True:
            request = urllib.request.Request(f"https://localhost:{PORT}/api/v1{path}", content, headers, method=method)
            try:
                with urllib.request.urlopen(request, timeout=30, context=ssl._create_unverified_context()) as answer:
                    return json.loads(answer.read())
            except urllib.error.HTTPError as error:
                said = error.read().decode(errors="replace")
                if error.code != 503 or time.monotonic() > end:
                    raise AssertionError(f"{method} {path}: {error.code} {said[:300]}") from None
            except OSError:
                if time.monotonic() > end:
                    raise
            time.sleep(1)

    def pair(self) -> None:
        """As a tablet, with what the command prints."""
        said = self.compose("exec", "-T", "server", "hilfit", "access", "pair", "--role", "admin", "--json")
        made = json.loads(said)
        assert made["url"].startswith(f"https://localhost:{PORT}/#pair="), made["url"]
        self._token = self.ask("POST", "/access/pair", {"code": made["code"], "name": "the test"})["token"]

    def record(self, machine: str, role: str, seconds: float) -> str:
        """Record; the id once it is sealed."""
        made = self.ask("POST", "/recordings", {"machine": machine, "role": role, "seconds": seconds})
        return str(self.until(f"/recordings/{made['id']}", lambda row: row["state"] == "sealed")["id"])

    def until(self, path: str, good: Any, longest: float = 180) -> Any:
        """What a path answers once that is good."""
        end = time.monotonic() + longest
        while not good(found := self.ask("GET", path)):
            assert time.monotonic() < end and found.get("state") != "failed", f"{path}: {str(found)[:500]}"
            time.sleep(0.5)
        return found

    def identify(self, machine: str, recordings: list[str]) -> tuple[str, str]:
        """Order an identification without the loop; its id, and that of its job."""
        wish = {"machine": machine, "recordings": [{"id": id} for id in recordings], "options": {"loop": False}}
        made = self.ask("POST", "/identifications", wish)
        return made["id"], made["job"]


def attempt(site: Site) -> None:
    """All that there is to try, in order."""
    site.build()
    site.compose("up", "--detach", "--no-build", "--wait", "--wait-timeout=150", timeout=200)
    site.say("up, and every container is healthy")
    site.pair()
    (machine,) = (row["name"] for row in site.ask("GET", "/machines")["items"])
    made = site.ask("POST", "/excitations", {"machine": machine, "duration_s": 60, "starts": 1, "seed": 1})
    site.until(f"/jobs/{made['job']}", lambda row: row["state"] == "done")
    site.say("paired, and a worker designed a motion")
    sent = site.ask("POST", f"/excitations/{made['id']}/send")["name"]
    while (
        sent
        not in json.loads(site.compose("exec", "-T", "server", "cat", "/data/simulation/controller.json"))["followed"]
    ):
        time.sleep(0.5)
    recordings = [site.record(machine, role, 20) for role in ("train", "validate")]
    site.say("recorded twice 20 s of it")
    _, job = site.identify(machine, recordings)
    taken = site.until(f"/jobs/{job}", lambda row: row["state"] == "running")
    hosts = {row["id"]: row for row in site.ask("GET", "/workers")["items"]}
    assert {"server", "worker-worker-1", "worker-worker-2"} <= set(hosts), hosts
    site.compose("kill", "worker-1")
    site.compose("stop", "--timeout=5", "database")
    site.say(f"in the stage {taken['stage']} a worker was killed, and the database stopped")
    time.sleep(30)
    site.compose("start", "database")
    found = site.until(f"/jobs/{job}", lambda row: row["state"] in ("done", "failed"))
    assert found["state"] == "done", found
    report = site.ask("GET", f"/identifications/{found['subject']}/report.json")
    assert report["schema"] == "hilfit/report/1"
    site.say("the database came back after 30 s, and the job was done once")
    backup = site.ask("POST", "/backups")["id"]
    before = fingerprint(site)
    site.compose("stop", "server", "worker-1", "worker-2", timeout=120)
    older(site, OLDER)
    site.compose("up", "--detach", "--no-build", "--wait", "--wait-timeout=150", timeout=200)
    kept = site.compose("exec", "-T", "server", "ls", "/backups")
    assert "before-version-5-4.pgdump" in kept, kept
    assert fingerprint(site) == before, "the certificate is another one"
    assert len(site.ask("GET", "/recordings")["items"]) == 2
    site.say("a store of version 4 was copied and upgraded; the certificate is the same")
    site.compose("stop", "server", "worker-1", "worker-2", timeout=120)
    older(site, "DELETE FROM identification_recordings; DELETE FROM identifications; DELETE FROM recordings")
    site.compose("run", "--rm", "-T", "--no-deps", "server", "hilfit", "restore", f"/backups/{backup}")
    site.compose("up", "--detach", "--no-build", "--wait", "--wait-timeout=150", timeout=200)
    assert len(site.ask("GET", "/recordings")["items"]) == 2
    assert site.ask("GET", f"/identifications/{found['subject']}/report.json") == report
    site.say("restored")


def fingerprint(site: Site) -> str:
    """Of the certificate, as the pairing address has it."""
    said = site.compose("exec", "-T", "server", "hilfit", "access", "pair", "--json")
    (found,) = re.findall("sha256=([0-9a-f]{64})", json.loads(said)["url"])
    return str(found)


def older(site: Site, statements: str) -> None:
    """Change the store behind the service's back."""
    program = "psql --host=127.0.0.1 --username=hilfit --set=ON_ERROR_STOP=1 --quiet hilfit"
    password = 'PGPASSWORD="$(cat /run/secrets/database_password)"'
    site.compose("exec", "-T", "database", "sh", "-c", f"{password} {program} -c '{statements}'")


def main() -> int:
    """The command."""

    bound = int(sys.argv[1]) if len(sys.argv) > 1 else BOUND_S

    def late(signum: int, frame: object) -> None:
        raise TimeoutError(f"not done within {bound} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(bound)
    try:
        with engine() as docker, tempfile.TemporaryDirectory(prefix="hilfit-try-") as name:
            site = Site(docker, Path(name))
            try:
                attempt(site)
            except AbsentError:
                raise
            except BaseException as error:
                signal.alarm(0)
                print(f"failed: {error}", flush=True)
                if (Path(name) / "here.yml").exists():
                    print(site.compose("ps", "--all"), site.compose("logs", "--no-color", "--tail=25"), sep="\n")
                return 1
            finally:
                signal.alarm(0)
                if (Path(name) / "here.yml").exists():
                    site.compose("down", "--volumes", "--timeout=10", timeout=120)
    except FailedError as absent:
        print(f"skipped: the composition: {absent}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
