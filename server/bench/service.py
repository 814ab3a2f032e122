"""Tablets on the live stream and readers of the REST interface while numerical work runs: latency, and lost cycles.

A real server on a free port of this computer with its simulated machine; clients in this process, over sockets. The
numerical work is the design of a motion, ordered through the service: a worker process of low priority, as a fit is.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import orjson
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from server.bench.targets import Check, Outcome

API = "/api/v1"
#: What readers ask for, in turn; a tablet's pages do the same.
PATHS = ("/status", "/machines", "/recordings", "/jobs", "/alarms", "/live", "/effects")
#: Seconds that the server has to come up.
START_S = 60.0


@dataclass
class Seen:
    """What the clients saw; ``late``: s by which their own event loop woke up too late, no matter what was answered."""

    seconds: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    statuses: dict[int, int] = field(default_factory=dict)
    samples: int = 0
    holes: int = 0
    dropped: int = 0


async def _read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: bytes) -> tuple[int, bytes]:
    """One request over a connection that stays open."""
    writer.write(request)
    head = await reader.readuntil(b"\r\n\r\n")
    lines = head.decode("latin-1").split("\r\n")
    sizes = [int(line.partition(":")[2]) for line in lines if line.lower().startswith("content-length:")]
    return int(lines[0].split()[1]), await reader.readexactly(sizes[0]) if sizes else b""


def _request(method: str, path: str, content: bytes = b"") -> bytes:
    more = f"Content-Type: application/json\r\nContent-Length: {len(content)}\r\n" if content else ""
    return f"{method} {API}{path} HTTP/1.1\r\nHost: 127.0.0.1\r\n{more}\r\n".encode() + content


async def ask(port: int, method: str, path: str, content: Any = None) -> Any:
    """One request; its JSON."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        body = b"" if content is None else json.dumps(content).encode()
        return json.loads((await _read(reader, writer, _request(method, path, body)))[1])
    finally:
        writer.close()


async def _reads(port: int, rate: float, until: float, first: int, seen: Seen) -> None:
    """Requests on one connection at absolute times: one that is late does not make the next one later."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    begin = time.monotonic() + first / rate / 10
    number = 0
    try:
        while (due := begin + number / rate) < until:
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            status, _ = await _read(reader, writer, _request("GET", PATHS[(number + first) % len(PATHS)]))
            # From when it was due: a server that falls behind cannot hide it by being asked later.
            seen.seconds.append(time.monotonic() - due)
            seen.statuses[status] = seen.statuses.get(status, 0) + 1
            number += 1
    finally:
        writer.close()


async def _own_delay(until: float, seen: Seen) -> None:
    """How late the clients' own event loop is: it waits for nobody's answer."""
    while (due := time.monotonic() + 0.02) < until:
        await asyncio.sleep(0.02)
        seen.late.append(time.monotonic() - due)


async def _tablet(port: int, machine: str, until: float, seen: Seen) -> None:
    expected = None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(until - time.monotonic()):
            try:
                async with connect(f"ws://127.0.0.1:{port}{API}/live/stream?machine={machine}") as socket:
                    async for text in socket:
                        message = orjson.loads(text)  # the clients share the cores with the server
                        if message["type"] == "frames":
                            seen.samples += len(message["samples"])
                        seen.holes += expected is not None and message["seq"] != expected
                        expected = message["seq"] + 1
            except WebSocketException:
                seen.dropped += 1


async def _run(port: int, tablets: int, rate: float, seconds: float, say: Callable[[str], None]) -> Outcome:
    machine = (await ask(port, "GET", "/machines"))["items"][0]["name"]
    for _ in range(int(START_S)):
        if (await ask(port, "GET", "/status"))["acquisition"].get(machine, {}).get("counts", {}).get("cycles"):
            break
        await asyncio.sleep(1.0)
    for path in PATHS:  # what a service loads when it is asked for the first time is not what is measured
        await ask(port, "GET", path)
    work = await ask(port, "POST", "/excitations", {"machine": machine, "label": "bench"})
    say(f"{tablets} tablets, {rate:g} requests/s, {seconds:g} s, job {work.get('job', work.get('id'))}")
    before = (await ask(port, "GET", "/status"))["acquisition"][machine]["counts"]
    seen, until = Seen(), time.monotonic() + seconds
    readers = [_reads(port, rate / 10, until, number, seen) for number in range(10)]
    streams = [_tablet(port, machine, until, seen) for _ in range(tablets)]
    await asyncio.gather(*readers, *streams, _own_delay(until, seen))
    status = await ask(port, "GET", "/status")
    after = status["acquisition"][machine]["counts"]
    busy = status["jobs"].get("running", 0) + status["jobs"].get("done", 0)
    p50, p99 = np.quantile(seen.seconds, [0.5, 0.99]) * 1e3
    late = np.quantile(seen.late, 0.99) * 1e3
    lost = after["skipped"] - before["skipped"]
    failed = sum(number for code, number in seen.statuses.items() if code != 200)
    cycles = after["cycles"] - before["cycles"]
    return Outcome(
        (
            Check("p50 of reading", p50, f"{p50:.1f} ms"),
            Check("p99 of reading", p99, f"{p99:.1f} ms of {len(seen.seconds)}", "at most", 100.0, "100 ms"),
            Check("p99 of the clients' own delay", late, f"{late:.1f} ms, contained in the above"),
            Check("answers other than 200", failed, f"{failed}", "at most", 0, "0"),
            Check("cycles lost", lost, f"{lost} of {cycles}", "at most", 0, "0"),
            Check("cycles late or slipped", after["late"] + after["slipped"] - before["late"] - before["slipped"],
                  f"{after['late'] + after['slipped'] - before['late'] - before['slipped']} of {cycles}"),
            Check("tablets dropped", seen.dropped, f"{seen.dropped} of {tablets}", "at most", 0, "0"),
            Check("holes in streams", seen.holes, f"{seen.holes}", "at most", 0, "0"),
            Check("samples per tablet and cycle", seen.samples / tablets / max(cycles, 1),
                  f"{seen.samples / tablets / max(cycles, 1):.3f}"),
            Check("numerical jobs that ran", busy, f"{busy}", "at least", 1, "1"),
        )
    )  # fmt: skip


def run(tablets: int, rate: float, seconds: float, say: Callable[[str], None]) -> Outcome:
    """Start a server, load it, and say what was seen.

    Parameters
    ----------
    tablets : clients of the live stream
    rate : requests per second of all readers together
    seconds : of load
    """
    with tempfile.TemporaryDirectory(prefix="hilfit-bench-") as directory:
        command = [sys.executable, "-m", "server.cli", "serve", "--simulate", "--port", "0", "--json"]
        with subprocess.Popen(
            [*command, "--data-dir", directory], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        ) as server:
            try:
                assert server.stdout is not None
                port = int(json.loads(server.stdout.readline())["url"].rpartition(":")[2])
                return asyncio.run(_run(port, tablets, rate, seconds, say))
            finally:
                server.terminate()
