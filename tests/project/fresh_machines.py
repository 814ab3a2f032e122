"""Runs ``make demo`` and ``make test`` on machines that have nothing yet: Debian 12 and 13, as root and as a user.

``python3 tests/project/fresh_machines.py [RELEASE...] [--as root|user] [--run demo|test]`` makes each machine with
mmdebstrap in a temporary folder, puts the files of this checkout into it, and runs the commands in namespaces of their
own, so that nothing of them is left. What pip and apt are told on this computer (indexes, mirrors, proxies,
certificates) they are told there. Needs root; where it cannot run it says why, and ends with 2.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[2]
RELEASES = ("bookworm", "trixie")
PACKAGES = "ca-certificates,git,make,python3"
#: s, of each step: a machine is made in one minute, the demo takes two, all tests fifteen on two idle cores.
BOUND_S = {"make": 900.0, "demo": 1200.0, "test": 5400.0}
PATH = "/usr/sbin:/usr/bin:/sbin:/bin"
#: What programs are told about the way into the network.
_NETWORK = re.compile(r"(https?|no|all)_proxy|SSL_CERT_(FILE|DIR)|REQUESTS_CA_BUNDLE|CURL_CA_BUNDLE", re.IGNORECASE)
#: What a process mounts, and its children, are in namespaces of their own and go with it: no folder that is removed
#: afterwards has anything of this computer mounted in it, whatever was interrupted.
_APART = ("unshare", "--mount", "--pid", "--fork", "--kill-child")
#: What pytest writes above what failed.
_HEADINGS = ("FAILURES", "ERRORS")
#: Mounts: $1 is the machine, $2 who runs, then places, "--" and a command.
_ENTER = """
machine=$1 who=$2; shift 2
mount --make-rprivate /
mount -t proc proc "$machine/proc"; mount --rbind /dev "$machine/dev"; mount -t sysfs sys "$machine/sys"
for place in /etc/resolv.conf /etc/hosts; do cat $place > "$machine$place"; done
while [ "$1" != -- ]; do
  if [ -d "$1" ]; then mkdir -p "$machine$1"; else mkdir -p "$machine$(dirname "$1")"; touch "$machine$1"; fi
  mount --bind -o ro "$1" "$machine$1"; shift
done
shift
exec chroot --userspec="$who" "$machine" "$@"
"""


@dataclass(frozen=True)
class Told:
    """What pip and apt are told here: variables, the places that these name, apt's options and mirror."""

    environment: dict[str, str]
    places: tuple[Path, ...]
    apt: tuple[str, ...]
    mirror: str | None


def unavailable() -> str | None:
    """Why no machine can be made here; None if it can."""
    if os.geteuid() != 0:
        return "needs root, to make machines and to enter them; run: sudo make test-fresh"
    for program, package in (("mmdebstrap", "mmdebstrap"), ("unshare", "util-linux"), ("git", "git")):
        if shutil.which(program) is None:
            return f"there is no {program}; install it with: apt-get install {package}"
    if subprocess.run(["unshare", "--mount", "--pid", "--fork", "true"], capture_output=True).returncode:
        return "this computer lets nobody make namespaces (a container without CAP_SYS_ADMIN); use another"
    return None


def told() -> Told:
    """Ask pip and apt."""
    environment = {name: value for name, value in os.environ.items() if _NETWORK.fullmatch(name)}
    listed = _said(sys.executable, "-m", "pip", "config", "list").splitlines()
    for line in sorted(listed, key=lambda line: line.startswith(":env:")):  # what the environment says comes last
        key, _, value = line.partition("=")
        name = key.rpartition(".")[2].replace("-", "_").upper()
        environment[f"PIP_{name}"] = " ".join(str(ast.literal_eval(value)).split())
    apt = tuple(
        line for line in _said("apt-config", "dump").splitlines() if re.match(r"Acquire::https?::.* \"..*", line)
    )
    release = dict(line.split("=", 1) for line in Path("/etc/os-release").read_text().splitlines() if "=" in line)
    debian = release.get("ID") == "debian" and release.get("VERSION_CODENAME")
    targets = (
        line.split() for line in _said("apt-get", "indextargets", "--format", "$(REPO_URI) $(RELEASE)").splitlines()
    )
    mirror = next((uri for uri, name in targets if debian and name == debian), None)
    return Told(environment, tuple(_places(environment)), apt, mirror)


def _said(*command: str) -> str:
    """Standard output of a program; nothing if it is not there or refuses."""
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""


def _places(environment: dict[str, str]) -> Iterator[Path]:
    """Files and folders of this computer that are named; certificates are also those of the system."""
    words = " ".join(environment.values()).split()
    local = [Path(unquote(urlsplit(word).path)) for word in words if word.startswith("file:")]
    found = {Path("/etc/ssl/certs/ca-certificates.crt"), *map(Path, words), *local}
    present = {place for place in found if place.is_absolute() and place != Path("/") and place.exists()}
    # Pages of an index lead to files that lie beside it.
    present |= {place.parent for place in present.intersection(local) if len(place.parents) > 1}
    return (place for place in sorted(present) if present.isdisjoint(place.parents))


def make(release: str, machine: Path, settings: Told) -> None:
    """Make a machine with the packages that README.md names, and a user."""
    command = [*_APART, "mmdebstrap", "--mode=root", "--variant=minbase", f"--include={PACKAGES}", "--quiet"]
    if (keyrings := Path("/usr/share/keyrings")).is_dir():
        command.append(f"--keyring={keyrings}")
    command += [f"--aptopt={line}" for line in settings.apt]
    command += [release, str(machine), *([settings.mirror] if settings.mirror else [])]
    subprocess.run(command, check=True, timeout=BOUND_S["make"])
    enter(machine, "root", settings, "useradd -m -s /bin/bash user", BOUND_S["make"])


def enter(machine: Path, who: str, settings: Told, script: str, bound_s: float) -> tuple[int, str]:
    """Run a script on the machine; its status (124: not within the bound, and ended) and what it printed.

    All its processes end with it.
    """
    home = "/root" if who == "root" else f"/home/{who}"
    variables = {"PATH": PATH, "HOME": home, "USER": who, "LANG": "C.UTF-8", **settings.environment}
    command = [*_APART, "sh", "-euc", _ENTER, "sh", str(machine), who]
    command += [
        *map(str, settings.places),
        "--",
        "env",
        "-i",
        *(f"{name}={value}" for name, value in variables.items()),
    ]
    command += ["bash", "-c", f"cd && {script}"]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as running:
        try:
            output, _ = running.communicate(timeout=bound_s)
        except subprocess.TimeoutExpired:
            running.kill()
            output, _ = running.communicate()
            return 124, f"{output}\nwas ended after {bound_s:g} s"
    return running.returncode, output


def put_checkout(machine: Path, who: str, settings: Told) -> None:
    """Copy what git knows of this checkout, or would add, to ``hilfit`` in the home of ``who``."""
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip
    target = machine / ("root" if who == "root" else f"home/{who}") / "hilfit"
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():  # not one that was deleted
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, target / name)
    enter(machine, "root", settings, f"chown -R {who}: ~{who}/hilfit", BOUND_S["make"])


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("releases", nargs="*", default=RELEASES, help="of Debian, by name")
    parser.add_argument("--as", dest="people", action="append", choices=("root", "user"))
    parser.add_argument("--run", action="append", choices=("demo", "test"))
    asked = parser.parse_args()
    if (reason := unavailable()) is not None:
        print(f"make test-fresh: {reason}", file=sys.stderr)
        return 2
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))  # what is running ends with it
    settings, failed = told(), 0
    for release in asked.releases:
        with TemporaryDirectory(prefix="hilfit-fresh-") as place:
            machine = Path(place) / release
            print(f"{release}: making a machine", flush=True)
            make(release, machine, settings)
            for who in asked.people or ("root", "user"):
                if who != "root":  # for root, make installs it
                    enter(
                        machine, "root", settings, "apt-get update && apt-get install -y python3-venv", BOUND_S["make"]
                    )
                put_checkout(machine, who, settings)
                failed += sum(_tried(machine, who, target, settings) for target in asked.run or ("demo", "test"))
    return min(failed, 1)


def _tried(machine: Path, who: str, target: str, settings: Told) -> bool:
    """Run a target and say what came of it; whether it failed."""
    print(f"{machine.name}, {who}: make {target}", flush=True)
    started = time.monotonic()
    status, output = enter(
        machine, who, settings, f"cd hilfit && python3 --version && make {target} 2>&1", BOUND_S[target]
    )
    lines = output.rstrip().splitlines() or ["nothing was printed"]
    took = f"{time.monotonic() - started:.0f} s"
    if status:
        told = (number for number, line in enumerate(lines) if line.startswith("=") and line.strip("= ") in _HEADINGS)
        print("\n".join(lines[min(next(told, len(lines)), len(lines) - 60) if len(lines) > 60 else 0 :]))
        print(f"{machine.name}, {lines[0]}, {who}: make {target} FAILED ({status}) after {took}", flush=True)
        return True
    print(f"{machine.name}, {lines[0]}, {who}: make {target} passed in {took}: {lines[-1]}", flush=True)
    return False


if __name__ == "__main__":
    raise SystemExit(main())
