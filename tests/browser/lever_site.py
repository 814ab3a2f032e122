"""A site in a process of its own, that tests start, kill and start again at the same address."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2

SCRIPT = Path(__file__).with_name("serve_lever.py")
API = "/api/v1"
_CODE = re.compile(r"pair the first admin with (\d{10})")


def wait_until(page: Any, answer: Callable[[], Any], wanted: Any) -> None:
    """Ask until the answer is the wanted one: what the page does after it drew comes later than what it drew.

    It is asked from here: a function that the browser polls would be an "eval", which the page forbids.
    """
    for _ in range(300):
        if answer() == wanted:
            return
        page.wait_for_timeout(100)
    assert answer() == wanted


class Site:
    """The server of one test module; ``access`` required: every request needs a token."""

    def __init__(self, data_dir: Path, access: str = "loopback") -> None:
        self.data_dir = data_dir
        self._access = access
        self._port = 0
        self._process: subprocess.Popen[str] | None = None
        self._said: list[str] = []
        self._reader: threading.Thread | None = None
        self._coded = threading.Event()
        self.url = ""

    def start(self) -> None:
        """Start it and wait until it listens; the second time at the port of the first."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith("HILFIT_")}
        process = subprocess.Popen(
            [sys.executable, str(SCRIPT), str(self.data_dir), str(self._port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**environment, "HILFIT_ACCESS": self._access},
        )
        self._process = process
        self._reader = threading.Thread(target=self._listen, args=(process,), daemon=True)
        self._reader.start()
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line, "".join(self._said)
        self.url = str(json.loads(line)["url"])
        self._port = int(self.url.rpartition(":")[2])

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            self._said.append(line)
            if _CODE.search(line):
                self._coded.set()

    def kill(self) -> None:
        """As when the plug is pulled."""
        if self._process is not None:
            self._process.kill()
            self._process.wait(30)
            assert self._process.stdout is not None and self._process.stderr is not None and self._reader is not None
            self._process.stdout.close()
            self._reader.join(30)
            self._process.stderr.close()
            self._process = None

    def first_code(self) -> str:
        """The code that the first start prints."""
        assert self._coded.wait(30)
        found = _CODE.search("".join(self._said))
        assert found is not None
        return found[1]

    def ask(self, method: str, path: str, **content: Any) -> Any:
        """A request of a program."""
        response = httpx2.request(method, f"{self.url}{API}{path}", timeout=30, **content)
        assert response.status_code < 300, response.text
        return response.json() if response.content else None
