"""Tablets on the live stream, readers and uploads at the REST interface while fits run: latency, and lost cycles.

A real server on a free port of this computer with its simulated machine; clients in this process, over sockets. The
fits are identifications of uploaded recordings, one after another as long as the load lasts.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import httpx2
import numpy as np
import orjson
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from benchmarks.service.hosts import API, ordered, running, uploaded, wait_until
from benchmarks.service.start import before_the_first_frame, cpu_s
from benchmarks.targets import Check, Outcome, Show, fact, figure
from server.platform.processes.precedence import take_precedence
from sim_backends import default_machine
from sim_backends.plant.cases import make_case

#: What readers ask for, in turn; a tablet's pages do the same.
PATHS = ("/status", "/machines", "/recordings", "/jobs", "/alarms", "/live", "/effects")
#: Seconds that the server has to come up.
START_S = 60.0
#: Seconds, beside those of the load, after which busy strangers end by themselves.
LONGEST_S = 180.0
#: Length of the recordings that are fitted, s of machine time, and s of load per identification that is ordered: each
#: takes longer than that.
FITTED_S, PER_FIT_S = 60.0, 4.0
#: What a service that has enough to do answers an upload, and s until it is sent again.
BUSY, BUSY_S = (429, 503), 1.0


@dataclass
class _Seen:
    """Measurements of the clients; ``late``: s by which their own event loop woke up late, whatever was answered."""

    seconds: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    statuses: dict[int, int] = field(default_factory=dict)
    uploads: dict[int, int] = field(default_factory=dict)
    samples: int = 0
    holes: int = 0
    dropped: int = 0


async def _read(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, request: bytes) -> tuple[int, bytes]:
    """Send one request over a connection that is kept open."""
    writer.write(request)
    head = await reader.readuntil(b"\r\n\r\n")
    lines = head.decode("latin-1").split("\r\n")
    sizes = [int(line.partition(":")[2]) for line in lines if line.lower().startswith("content-length:")]
    return int(lines[0].split()[1]), await reader.readexactly(sizes[0]) if sizes else b""


def _request(method: str, path: str, content: bytes = b"") -> bytes:
    kind = "octet-stream" if "/upload?" in path else "json"
    more = f"Content-Type: application/{kind}\r\nContent-Length: {len(content)}\r\n" if content else ""
    return f"{method} {API}{path} HTTP/1.1\r\nHost: 127.0.0.1\r\n{more}\r\n".encode() + content


async def _reads(port: int, rate: float, until: float, first: int, seen: _Seen) -> None:
    """Send requests on one connection at absolute times: a late one does not delay the next."""
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


async def _uploads(port: int, place: str, content: bytes, until: float, seen: _Seen) -> None:
    """Upload one recording after another; where the service is busy, again at the time that it names."""
    number = 0
    while time.monotonic() < until:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        try:
            status, _ = await _read(reader, writer, _request("POST", f"{place}-{number}.parquet", content))
        finally:
            writer.close()
        seen.uploads[status] = seen.uploads.get(status, 0) + 1
        number += 1
        if status in BUSY:
            await asyncio.sleep(min(BUSY_S, max(0.0, until - time.monotonic())))


async def _own_delay(until: float, seen: _Seen) -> None:
    """Measure how late the clients' own event loop is: it waits for nobody's answer."""
    while (due := time.monotonic() + 0.02) < until:
        await asyncio.sleep(0.02)
        seen.late.append(time.monotonic() - due)


async def _tablet(port: int, machine: str, until: float, seen: _Seen) -> None:
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


async def _run(
    port: int, client: httpx2.Client, case: Path, tablets: int, rate: float, uploads: int, seconds: float, show: Show
) -> Outcome:
    machine = client.get("/machines").json()["items"][0]["name"]
    for _ in range(int(START_S)):
        if client.get("/status").json()["acquisition"].get(machine, {}).get("counts", {}).get("cycles"):
            break
        await asyncio.sleep(1.0)
    for path in PATHS:  # what a service loads when it is asked for the first time is not what is measured
        client.get(path)
    fits = 1 + int(seconds / PER_FIT_S)
    order = {"machine": machine, "recordings": uploaded(client, machine, case)}
    for _ in range(fits):  # they run one after another
        ordered(client, order)
    show(f"{tablets} tablets, {rate:g} requests/s, {uploads} uploads, {seconds:g} s, identifications one after another")
    before = client.get("/status").json()["acquisition"][machine]["counts"]
    seen, until = _Seen(), time.monotonic() + seconds
    readers = [_reads(port, rate / 10, until, number, seen) for number in range(10)]
    streams = [_tablet(port, machine, until, seen) for _ in range(tablets)]
    content = (case / "train-1.parquet").read_bytes()
    place = f"/recordings/upload?machine={machine}&role=train&name=up"
    senders = [
        asyncio.create_task(_uploads(port, f"{place}-{number}", content, until, seen)) for number in range(uploads)
    ]
    await asyncio.gather(*readers, *streams, _own_delay(until, seen))
    status = client.get("/status").json()
    await asyncio.gather(*senders)  # the last ones are answered when the load is over
    after = status["acquisition"][machine]["counts"]
    done, running = (status["jobs"].get(state, 0) for state in ("done", "running"))
    p50, p99 = np.quantile(seen.seconds, [0.5, 0.99]) * 1e3
    late = np.quantile(seen.late, 0.99) * 1e3
    lost = after["skipped"] - before["skipped"]
    failed = sum(number for code, number in seen.statuses.items() if code != 200)
    cycles = after["cycles"] - before["cycles"]
    taken, later = seen.uploads.get(201, 0), sum(seen.uploads.get(code, 0) for code in BUSY)
    strange = sum(number for code, number in seen.uploads.items() if code not in (201, *BUSY))
    return Outcome(
        (
            figure("p50 of reading", p50, "{:.1f} ms"),
            figure("p99 of reading", p99, "{:g} ms", most=100.0, shown=f"{p99:.1f} ms of {len(seen.seconds)}"),
            figure("p99 of the clients' own delay", late, "{:.1f} ms, contained in the above"),
            figure("answers other than 200", failed, most=0),
            Check("uploads accepted", taken, f"{taken}; told to come again later: {later}"),
            figure("uploads answered otherwise", strange, most=0),
            figure("cycles lost", lost, most=0, shown=f"{lost} of {cycles}"),
            Check("cycles late or slipped", after["late"] + after["slipped"] - before["late"] - before["slipped"],
                  f"{after['late'] + after['slipped'] - before['late'] - before['slipped']} of {cycles}"),
            figure("tablets dropped", seen.dropped, most=0, shown=f"{seen.dropped} of {tablets}"),
            figure("holes in streams", seen.holes, most=0),
            figure("samples per tablet and cycle", seen.samples / tablets / max(cycles, 1), "{:.3f}"),
            fact("a fit ran all the time", running == 1 and done < fits, f"{done} done, {running} running at the end"),
        )
    )  # fmt: skip


def run(tablets: int, rate: float, uploads: int, seconds: float, others: int, show: Show) -> Outcome:
    """Start a server, load it, and report what was seen."""
    with tempfile.TemporaryDirectory(prefix="hilfit-bench-") as directory:
        case = Path(directory) / "case"
        make_case(case, default_machine(), 0, seconds=FITTED_S)
        words = ["serve", "--simulate", "--port", "0", "--json", "--data-dir", f"{directory}/data"]
        with (
            running(words, subprocess.DEVNULL) as (server, up),
            httpx2.Client(base_url=up["url"] + API, timeout=LONGEST_S) as client,
        ):
            wait_until(lambda: bool(client.get("/live").json()), START_S, "the first live frame")
            start = before_the_first_frame(server.pid)
            port = int(up["url"].rpartition(":")[2])
            take_precedence()  # the clients of a site have computers of their own
            with _strangers(others, LONGEST_S + seconds):
                before, began = cpu_s(server.pid), time.monotonic()
                outcome = asyncio.run(_run(port, client, case, tablets, rate, uploads, seconds, show))
                share = (cpu_s(server.pid) - before) / (time.monotonic() - began)
            beside = (
                figure("load of the computer at the end", os.getloadavg()[0], "{:.1f}"),
                figure("niceness of the service", os.getpriority(os.PRIO_PROCESS, server.pid), "{:d}"),
                figure("processor that the service took", share, "{:.2f} cores"),
            )
            return replace(outcome, checks=(start, *beside, *outcome.checks))


#: So many processes count until their time is over, or whoever started them has gone.
_LOOP = """
import os, sys, time
number, end, parent = int(sys.argv[1]), time.monotonic() + float(sys.argv[2]), int(sys.argv[3])
first = os.getpid()
os.setpriority(os.PRIO_PROCESS, 0, 0)
while number > 1 and os.fork():
    number -= 1
while time.monotonic() < end and os.getppid() in (parent, first):
    for _ in range(100_000):
        pass
"""


@contextmanager
def _strangers(number: int, longest_s: float) -> Iterator[None]:
    """Run so many busy loops during the block, in a session of their own, as another user's shell has them.

    Parameters
    ----------
    longest_s : s after which each ends by itself
    """
    if not number:
        yield
        return
    command = [sys.executable, "-I", "-S", "-c", _LOOP, str(number), str(longest_s), str(os.getpid())]
    with subprocess.Popen(command, start_new_session=True) as process:
        try:
            yield
        finally:
            os.killpg(process.pid, signal.SIGKILL)
