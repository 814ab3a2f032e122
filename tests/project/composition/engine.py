"""A Docker engine for a test: the one that runs here, or one of Debian's packages, started by hand and ended again."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

HERE = Path(__file__).resolve().parent
TOP = HERE.parents[2]
#: Of the engine; Debian 12 has no plugins for it, the next one has.
PACKAGES, PLUGINS, PLUGINS_OF = ("docker.io", "iptables", "mmdebstrap"), ("docker-compose", "docker-buildx"), "trixie"


class FailedError(Exception):
    """A program failed; the text says what it said."""


class AbsentError(FailedError):
    """There is no engine here; the text says why."""


def run(command: Sequence[str], timeout: float, **options: object) -> str:
    """Run a program; what it prints. FailedError if it fails."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=timeout,
            stdin=subprocess.DEVNULL,
            **options,  # type: ignore[call-overload]
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FailedError(f"{' '.join(command[:3])}: {error}") from None
    if done.returncode != 0:
        raise FailedError(f"{' '.join(command[-6:])} failed: {' '.join(done.stderr.split())[-300:]}")
    return str(done.stdout)


class Engine:
    """A running engine.

    Attributes
    ----------
    docker : begin of every command line
    environment : of its client
    """

    def __init__(self, docker: str, environment: dict[str, str]) -> None:
        self.docker, self.environment = docker, environment

    def __call__(self, *arguments: str, timeout: float = 120, cwd: Path | None = None) -> str:
        """Run its client; what that prints."""
        return run([self.docker, *arguments], timeout, env=self.environment, cwd=cwd)


@contextmanager
def engine() -> Iterator[Engine]:
    """An engine with Compose; AbsentError where there can be none."""
    with tempfile.TemporaryDirectory(prefix="hilfit-engine-") as name:
        directory = Path(name)
        environment = dict(os.environ)
        for docker in filter(None, (shutil.which("docker"), "/usr/bin/docker")):
            if _answers(docker):
                yield Engine(docker, environment)
                return
        if sys.platform != "linux" or os.geteuid() != 0:
            raise AbsentError("no Docker engine with Compose answers here, and only root could start one")
        if shutil.which("apt-get") is None:
            raise AbsentError("no Docker engine answers here, and there is no apt-get")
        if shutil.which("dockerd") is None or shutil.which("mmdebstrap") is None:
            apt = {**environment, "DEBIAN_FRONTEND": "noninteractive"}
            with suppress(FailedError):  # somebody else does it just now, or the lists are new enough
                run(["apt-get", "update", "-qq"], 90, env=apt)
            run(
                [
                    "apt-get",
                    "-o",
                    "DPkg::Lock::Timeout=60",
                    "install",
                    "-y",
                    "-qq",
                    "--no-install-recommends",
                    *PACKAGES,
                ],
                180,
                env=apt,
            )
        _plugins(directory)
        environment |= {"DOCKER_HOST": f"unix://{directory}/docker.sock", "DOCKER_CONFIG": str(directory / "client")}
        options = [f"--data-root={directory}/data", f"--exec-root={directory}/run", f"--pidfile={directory}/pid"]
        with (directory / "dockerd.log").open("wb") as log:
            process = subprocess.Popen(
                ["dockerd", *options, "-H", environment["DOCKER_HOST"]], stdout=log, stderr=log, start_new_session=True
            )
        try:
            found = Engine("/usr/bin/docker", environment)
            for _ in range(60):
                with suppress(FailedError):
                    found("info", timeout=5)
                    break
                if process.poll() is not None:
                    break
                time.sleep(0.5)
            else:
                raise AbsentError("dockerd does not answer")
            if process.poll() is not None:
                last = (directory / "dockerd.log").read_text(errors="replace").strip().splitlines()[-1:]
                raise AbsentError(f"dockerd cannot run here: {' '.join(last)[-300:]}")
            yield found
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(30)


def _answers(docker: str) -> bool:
    """Whether an engine with Compose is behind a client."""
    try:
        run([docker, "info"], 20)
        run([docker, "compose", "version"], 20)
    except FailedError:
        return False
    return True


def _plugins(directory: Path) -> None:
    """Compose and buildx as plugins of the client, out of packages of the next Debian, which is not installed."""
    apt, target = directory / "apt", directory / "client" / "cli-plugins"
    for place in (apt / "lists", apt / "cache" / "archives" / "partial", apt / "sources", target):
        place.mkdir(parents=True)
    # From where this computer has its own packages.
    sources = [*Path("/etc/apt").glob("sources.list"), *Path("/etc/apt/sources.list.d").glob("debian*")]
    for source in sources:
        text = re.sub(r"\bbookworm\b", PLUGINS_OF, source.read_text())
        (apt / "sources" / source.name).write_text(text)
    options = {
        "Dir::Etc::sourcelist": "/dev/null",
        "Dir::Etc::sourceparts": str(apt / "sources"),
        "Dir::State::lists": str(apt / "lists"),
        "Dir::Cache": str(apt / "cache"),
    }
    given = [word for name, value in options.items() for word in ("-o", f"{name}={value}")]
    run(["apt-get", *given, "update", "-qq"], 90)
    run(["apt-get", *given, "download", *PLUGINS], 90, cwd=apt)
    for package in apt.glob("*.deb"):
        run(["dpkg-deb", "-x", str(package), str(apt / "files")], 60)
    for plugin in (apt / "files").rglob("cli-plugins/*"):
        shutil.copy2(plugin, target / plugin.name)


def base_image(docker: Engine, name: str) -> str:
    """A base of Debian 12 with Python, under that name, as this computer reaches packages; the name."""
    with tempfile.TemporaryDirectory(prefix="hilfit-base-") as directory:
        place = Path(directory)
        sources = [str(path) for path in Path("/etc/apt/sources.list.d").glob("debian*")] or ["/etc/apt/sources.list"]
        packages = "--include=python3,python3-venv,ca-certificates"
        # Without what the slim images of the registry do without.
        left_out = [f"--dpkgopt=path-exclude=/usr/share/{folder}/*" for folder in ("doc", "man", "locale")]
        mmdebstrap = ["mmdebstrap", "--variant=minbase", "--skip=check/empty", *left_out, packages, "bookworm"]
        run([*mmdebstrap, str(place / "base.tar"), *sources], 600)
        docker("import", str(place / "base.tar"), f"{name}-bare", timeout=120)
        (place / "context").mkdir()
        shutil.copy("/etc/ssl/certs/ca-certificates.crt", place / "context")
        pip = run([sys.executable, "-m", "pip", "config", "list"], 30)
        # Not what names a folder of this computer.
        known = dict(re.findall(r"^(?:global|:env:)\.([\w-]+)='(.*)'$", pip, re.MULTILINE))
        wanted = {key: value for key, value in known.items() if key in ("index-url", "proxy", "trusted-host")}
        lines = "".join(f"{key} = {value}\n" for key, value in wanted.items())
        certificates = "/etc/ssl/certs/ca-certificates.crt"
        (place / "context" / "pip.conf").write_text(f"[global]\ncert = {certificates}\n{lines}")
        (place / "context" / "Dockerfile").write_text(
            f"FROM {name}-bare\nCOPY ca-certificates.crt {certificates}\nCOPY pip.conf /etc/pip.conf\n"
            "RUN ln -sf python3 /usr/bin/python\n"
        )
        docker("build", "--quiet", "--tag", name, str(place / "context"), timeout=120)
    return name
