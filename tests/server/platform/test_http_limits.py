"""Bounds of connections, probed over sockets of this computer: headers, half-open requests, stalled bodies, no HTTP."""

from __future__ import annotations

import contextlib
import json
import resource
import select
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace

import pytest
import uvicorn
from fastapi import FastAPI, Request

from server.platform.http.http_limits import BoundedHttp, HttpLimits

#: Short times, so that a probe need not wait for the real ones.
LIMITS = replace(HttpLimits(), header_s=0.5, body_idle_s=0.5, connections=60)


def application() -> FastAPI:
    app = FastAPI()

    @app.api_route("/", methods=["GET", "POST"])
    async def answer(request: Request) -> int:
        return len(await request.body())

    return app


@contextlib.contextmanager
def serving(bounds: HttpLimits) -> Iterator[int]:
    """The port of a server with these limits."""

    class Bounded(BoundedHttp):
        limits = bounds

    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = uvicorn.Server(uvicorn.Config(application(), http=Bounded, log_config=None, lifespan="off"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            yield int(listening.getsockname()[1])
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with serving(LIMITS) as found:
        yield found


@contextlib.contextmanager
def connection(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=20) as found:
        yield found


def said(found: socket.socket) -> bytes:
    """Everything until the server hangs up."""
    parts = []
    with contextlib.suppress(ConnectionResetError):  # it hung up while more was on its way
        while part := found.recv(65536):
            parts.append(part)
    return b"".join(parts)


def problem(answer: bytes) -> tuple[int, str]:
    """Status and type of a problem document."""
    head, _, body = answer.partition(b"\r\n\r\n")
    assert b"application/problem+json" in head
    content = json.loads(body)
    assert content["status"] == int(head.split()[1])
    return content["status"], content["type"]


def test_an_ordinary_request_and_another_on_the_same_connection_are_answered(port: int) -> None:
    with connection(port) as found:
        for _ in range(2):
            found.sendall(b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 3\r\n\r\nabc")
            answer = b""
            while b"\r\n\r\n3" not in answer:
                answer += found.recv(4096)
            assert answer.startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    "request_of",
    [
        b"GET / HTTP/1.1\r\n" + b"".join(b"X-%d: %s\r\n" % (n, b"v" * 1000) for n in range(99)),
        b"GET / HTTP/1.1\r\n" + b"".join(b"X-%d: v\r\n" % n for n in range(110)),
        b"GET / HTTP/1.1\r\nX: " + b"v" * 200_000,
        b"GET /" + b"p" * 200_000,
        b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n" + b"X: v\r\n" * 200,
    ],
    ids=["long", "many", "one", "line", "trailers"],
)
def test_headers_are_bounded(port: int, request_of: bytes) -> None:
    with connection(port) as found:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            found.sendall(request_of)
        answer = said(found)
    if answer:  # else the rest of the request came after it had hung up
        assert problem(answer) == (431, "urn:hilfit:problem:request-header-fields-too-large")


def test_a_flood_of_headers_costs_no_memory(port: int) -> None:
    """123 MB were kept of one connection; ru_maxrss is in KiB."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sent = 0
    with connection(port) as found, contextlib.suppress(BrokenPipeError, ConnectionResetError):
        found.sendall(b"GET / HTTP/1.1\r\n")
        for number in range(1000):
            sent += found.send(b"X-%d: %s\r\n" % (number, b"v" * 60_000))
    assert sent < 16 * 2**20, "the server has to hang up"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20 * 2**10


@pytest.mark.slow
@pytest.mark.parametrize("begin", [b"", b"GET / HTTP/1.1\r\nHost: x\r\n", b"G"])
def test_half_open_requests_are_ended(port: int, begin: bytes) -> None:
    with contextlib.ExitStack() as stack:
        found = [stack.enter_context(connection(port)) for _ in range(20)]
        for one in found:
            one.sendall(begin)
        assert [problem(said(one))[0] for one in found] == [408] * 20


def test_a_request_sent_byte_by_byte_is_ended(port: int) -> None:
    with connection(port) as found:
        found.settimeout(0.1)
        answer = b""
        for letter in b"GET / HTTP/1.1\r\nX: " + b"v" * 1000:
            try:
                found.sendall(bytes([letter]))
                answer = found.recv(4096)
                break
            except TimeoutError:
                continue
            except OSError:
                break
        assert not answer or problem(answer)[0] == 408


@pytest.mark.parametrize("declared", [b"Content-Length: 1000000", b"Transfer-Encoding: chunked"])
def test_a_body_that_stands_still_is_not_waited_for(port: int, declared: bytes) -> None:
    with connection(port) as found:
        found.sendall(b"POST / HTTP/1.1\r\nHost: x\r\n" + declared + b"\r\n\r\n1\r\n")
        assert problem(said(found))[0] == 408


@pytest.mark.slow
def test_the_second_request_of_a_connection_has_the_same_time(port: int) -> None:
    with connection(port) as found:
        found.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
        assert found.recv(4096).startswith(b"HTTP/1.1 200")
        found.sendall(b"GET / HTTP/1.1\r\nHost")
        assert b"HTTP/1.1 408" in said(found)


def test_what_is_no_http_is_told_by_a_problem_document(port: int) -> None:
    with connection(port) as found:
        found.sendall(b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n")
        assert problem(said(found)) == (400, "urn:hilfit:problem:bad-request")


def test_connections_are_counted() -> None:
    patient = replace(LIMITS, header_s=60.0)  # none of them is let go before all have come
    with serving(patient) as port, contextlib.ExitStack() as stack:
        found = [stack.enter_context(connection(port)) for _ in range(patient.connections + 10)]
        within, beyond = found[: patient.connections], found[patient.connections :]
        assert [problem(said(one))[0] for one in beyond] == [503] * 10
        assert select.select(within, [], [], 0)[0] == []
