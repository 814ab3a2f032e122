"""Hosts on this computer: network namespaces on one bridge, each with its own view of what is mounted.

Nothing leaves the bridge. What a host may not see is covered by an empty file system in its view.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks.service.postgresql import AbsentError

#: Of this process, so that others may have theirs.
_NUMBER = os.getpid() % 250
BRIDGE, HERE, NETWORK = f"hilfit{_NUMBER}", f"10.77.{_NUMBER}.1", f"10.77.{_NUMBER}.0/24"


class Host:
    """A namespace ``name`` with an address."""

    def __init__(self, name: str, number: int, hidden: Path) -> None:
        self.name, self.address = name, f"10.77.{_NUMBER}.{number + 10}"
        self._wire, self._hidden = f"hf{_NUMBER}-{number}", hidden

    def command(self, words: Sequence[str]) -> list[str]:
        """Return a command line as it is run there."""
        inner = 'mount -t tmpfs none "$0" && exec "$@"'
        return self.seeing_all(["unshare", "--mount", "sh", "-c", inner, str(self._hidden), *words])

    def seeing_all(self, words: Sequence[str]) -> list[str]:
        """Return the same, but nothing is hidden."""
        return ["ip", "netns", "exec", self.name, *words]

    def connect(self, up: bool) -> None:
        """Plug its wire in, or pull it."""
        _run("ip", "link", "set", self._wire, "up" if up else "down")

    def make(self) -> None:
        """Make it."""
        _run("ip", "netns", "add", self.name)
        _run("ip", "link", "add", self._wire, "type", "veth", "peer", "name", "eth0", "netns", self.name)
        _run("ip", "link", "set", self._wire, "master", BRIDGE, "up")
        for words in ((f"addr add {self.address}/24 dev eth0"), "link set eth0 up", "link set lo up"):
            _run("ip", "-n", self.name, *words.split())

    def remove(self) -> None:
        """Remove it with its wire."""
        subprocess.run(["ip", "netns", "del", self.name], capture_output=True)


@contextmanager
def hosts(count: int, hidden: Path) -> Iterator[tuple[Host, ...]]:
    """Start so many hosts; ``hidden`` is a directory of this computer that they do not see.

    Raises
    ------
    AbsentError
        If they cannot be made here.
    """
    if os.geteuid() != 0 or shutil.which("ip") is None or shutil.which("unshare") is None:
        raise AbsentError("hosts are network namespaces: run as root, with ip (iproute2) and unshare (util-linux)")
    made = tuple(Host(f"hilfit{_NUMBER}-{number}", number, hidden) for number in range(count))
    for host in made:
        host.remove()  # of a run that was killed
    subprocess.run(["ip", "link", "del", BRIDGE], capture_output=True)
    _run("ip", "link", "add", BRIDGE, "type", "bridge")
    try:
        _run("ip", "addr", "add", f"{HERE}/24", "dev", BRIDGE)
        _run("ip", "link", "set", BRIDGE, "up")
        for host in made:
            host.make()
        yield made
    finally:
        for host in made:
            host.remove()
        subprocess.run(["ip", "link", "del", BRIDGE], capture_output=True)


def _run(*words: str) -> None:
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0:
        raise AbsentError(f"{' '.join(words)}: {done.stderr.strip()}")
